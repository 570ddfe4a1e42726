//! What a scenario file holds: settings, what is connected, and cases.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use serde::Deserialize;
use toml::{Table, Value};

/// A file: what its cases have in common, and the cases.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct File {
    /// What the cases are about, for the reader.
    #[serde(rename = "about")]
    _about: String,
    settings: Option<String>,
    bus: Option<BTreeMap<String, Bus>>,
    server: Option<BTreeMap<SocketAddr, Server>>,
    client: Option<BTreeMap<String, Client>>,
    /// By name.
    case: BTreeMap<String, Table>,
}

/// The gateway's settings and its surroundings. What a case says replaces what the file says, table by table.
pub(crate) struct Setup {
    /// Lines as they are typed at the console.
    pub(crate) settings: String,
    /// The buses by the gateway's name for the device.
    pub(crate) bus: BTreeMap<String, Bus>,
    /// What the gateway finds at addresses of the network.
    pub(crate) server: BTreeMap<SocketAddr, Server>,
    /// The clients by name.
    pub(crate) client: BTreeMap<String, Client>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CaseText {
    steps: String,
    settings: Option<String>,
    /// Lines behind those of the file.
    #[serde(default)]
    more_settings: String,
    bus: Option<BTreeMap<String, Bus>>,
    server: Option<BTreeMap<SocketAddr, Server>>,
    client: Option<BTreeMap<String, Client>>,
}

/// What hangs on a serial line.
#[derive(Deserialize, Clone, Default)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Bus {
    /// Speed and format of the devices where it is not what the gateway's settings say: a settings line's words.
    pub(crate) line: Option<String>,
    /// The gateway's adapter hears itself.
    pub(crate) echo: bool,
    pub(crate) device: Vec<Device>,
}

/// A listener behind which devices are.
#[derive(Deserialize, Clone, Default)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Server {
    /// What it is called, for settings that name it.
    pub(crate) name: Option<String>,
    /// It speaks RTU over TCP.
    pub(crate) rtu: bool,
    pub(crate) device: Vec<Device>,
    /// To it and back.
    pub(crate) latency: Option<String>,
    /// It does not listen before a step says so.
    pub(crate) absent: bool,
    /// It accepts no connection.
    pub(crate) deaf: bool,
    /// It closes each connection after this time, and answers nothing.
    pub(crate) closes_after: Option<String>,
}

/// A Modbus device.
#[derive(Deserialize, Clone)]
#[serde(deny_unknown_fields)]
pub(crate) struct Device {
    pub(crate) unit: u8,
    /// From the end of the request's silence to the response.
    pub(crate) turnaround: Option<String>,
    /// Address of registers that differ at every read.
    pub(crate) fresh: Option<u16>,
    /// Address that it does not have.
    pub(crate) missing: Option<u16>,
    /// Sentences such as `every 3rd bad crc`.
    #[serde(default)]
    pub(crate) faults: Vec<String>,
    /// Pause that it needs behind its own response.
    pub(crate) rest: Option<String>,
    /// Its speed and format where that is not the bus's; it is `apart` then.
    pub(crate) line: Option<String>,
    /// A tap of its own instead of one that all devices of the bus share: it collides with the others.
    #[serde(default)]
    pub(crate) apart: bool,
}

/// A Modbus TCP client and its path to the gateway, or a master on a serial line.
#[derive(Deserialize, Clone)]
#[serde(deny_unknown_fields)]
pub(crate) struct Client {
    /// The line that it is the master of; what is said of its way by TCP means nothing then.
    pub(crate) on: Option<String>,
    #[serde(default = "anywhere")]
    pub(crate) from: IpAddr,
    #[serde(default = "modbus_port")]
    pub(crate) port: u16,
    pub(crate) latency: Option<String>,
    /// Writes arrive in pieces of up to so many bytes.
    pub(crate) pieces: Option<usize>,
    /// Between the pieces.
    pub(crate) spacing: Option<String>,
    /// Bytes arrive together at multiples of this time.
    pub(crate) coalesce: Option<String>,
    /// It speaks RTU over TCP, or sends datagrams.
    #[serde(default)]
    pub(crate) by: By,
    /// Bytes of window.
    pub(crate) window: Option<usize>,
    /// It never reads.
    #[serde(default)]
    pub(crate) deaf: bool,
}

/// How a client's frames travel in the network.
#[derive(Deserialize, Clone, Copy, Default, PartialEq)]
#[serde(rename_all = "lowercase")]
pub(crate) enum By {
    #[default]
    Tcp,
    Rtu,
    Udp,
}

fn anywhere() -> IpAddr {
    IpAddr::V4(Ipv4Addr::new(10, 0, 0, 1))
}

fn modbus_port() -> u16 {
    502
}

/// A case, ready to be played.
pub(crate) struct Case {
    pub(crate) name: String,
    pub(crate) steps: String,
    pub(crate) setup: Setup,
}

impl File {
    /// The cases; one with a table `each` is a case for each of its rows.
    pub(crate) fn cases(&self) -> Result<Vec<Case>, toml::de::Error> {
        let mut cases = Vec::new();
        for (name, case) in &self.case {
            let mut case = case.clone();
            let each =
                case.remove("each").map_or_else(|| Ok(vec![Table::new()]), Vec::<Table>::deserialize)?;
            for row in each.into_iter().flat_map(combinations) {
                let text = CaseText::deserialize(filled(&Value::Table(case.clone()), &row))?;
                let told: Vec<String> = row.iter().map(|(key, value)| format!("{key} {value}")).collect();
                let told = if told.is_empty() { String::new() } else { format!(" ({})", told.join(", ")) };
                cases.push(self.case(format!("{name}{told}"), text));
            }
        }
        Ok(cases)
    }

    fn case(&self, name: String, case: CaseText) -> Case {
        let setup = Setup {
            settings: own_or_common(case.settings, &self.settings) + &case.more_settings,
            bus: own_or_common(case.bus, &self.bus),
            server: own_or_common(case.server, &self.server),
            client: own_or_common(case.client, &self.client),
        };
        Case { name, steps: case.steps, setup }
    }
}

/// A row of keys and texts for each combination of the values of those keys that have a list of them.
fn combinations(row: Table) -> Vec<Vec<(String, String)>> {
    row.into_iter().fold(vec![vec![]], |rows, (key, value)| {
        let values = if let Value::Array(values) = value { values } else { vec![value] };
        let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let longer = |row: &Vec<_>, value| [&row[..], &[(key.clone(), text(value))]].concat();
        rows.iter().flat_map(|row| values.iter().map(move |value| longer(row, value))).collect()
    })
}

/// `value` with the texts of `row` wherever it has their keys in braces.
fn filled(value: &Value, row: &[(String, String)]) -> Value {
    match value {
        Value::String(text) => {
            let fill =
                |text: String, (key, with): &(String, String)| text.replace(&format!("{{{key}}}"), with);
            Value::String(row.iter().fold(text.clone(), fill))
        }
        Value::Array(values) => Value::Array(values.iter().map(|value| filled(value, row)).collect()),
        Value::Table(table) => {
            Value::Table(table.iter().map(|(key, value)| (key.clone(), filled(value, row))).collect())
        }
        other => other.clone(),
    }
}

fn own_or_common<T: Clone + Default>(own: Option<T>, common: &Option<T>) -> T {
    own.or_else(|| common.clone()).unwrap_or_default()
}
