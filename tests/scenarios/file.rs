//! What a scenario file holds: settings, what is connected, and cases.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use serde::de::Error;
use serde::{Deserialize, Deserializer};
use yaml_serde::{Mapping, Value};

use crate::script::{each, items};

/// Keys of a file that hold for each of its cases. All others are cases.
const COMMON: [&str; 8] = ["about", "settings", "more_settings", "bus", "server", "client", "first", "last"];

/// A case, ready to be played. What it says itself replaces what its file says, key by key.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Case {
    #[serde(skip)]
    pub(crate) name: String,
    /// What the cases of the file are about, for the reader.
    #[serde(rename = "about")]
    _about: String,
    /// Lines as they are typed at the console.
    pub(crate) settings: String,
    /// Lines behind `settings`. Those of the file are not for cases with `settings` of their own.
    #[serde(default)]
    more_settings: String,
    /// The buses by the gateway's name for the device.
    #[serde(default)]
    pub(crate) bus: BTreeMap<String, Bus>,
    /// What the gateway finds at addresses of the network.
    #[serde(default)]
    pub(crate) server: BTreeMap<SocketAddr, Server>,
    /// The clients by name.
    #[serde(default)]
    pub(crate) client: BTreeMap<String, Client>,
    /// Steps before those of the case.
    #[serde(default)]
    first: String,
    pub(crate) steps: String,
    /// Steps behind those of the case.
    #[serde(default)]
    last: String,
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
    #[serde(deserialize_with = "number_or_text")]
    pub(crate) unit: u8,
    /// From the end of the request's silence to the response.
    pub(crate) turnaround: Option<String>,
    /// Address of registers that differ at every read.
    pub(crate) fresh: Option<u16>,
    /// Address that it does not have.
    pub(crate) missing: Option<u16>,
    /// How long after a write it waits for the next one; then its holding registers are 0.
    pub(crate) watchdog: Option<String>,
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

fn number_or_text<'d, D: Deserializer<'d>>(deserializer: D) -> Result<u8, D::Error> {
    text_of(&Value::deserialize(deserializer)?).parse().map_err(D::Error::custom)
}

/// The cases of the file `text`; one with a list `each` is a case for each of its rows.
pub(crate) fn cases(text: &str) -> Result<Vec<Case>, yaml_serde::Error> {
    let file: Mapping = yaml_serde::from_str(text)?;
    let is_common = |(key, _): &(Value, Value)| key.as_str().is_some_and(|key| COMMON.contains(&key));
    let (common, own): (Mapping, Mapping) = file.into_iter().partition(is_common);
    let mut cases = Vec::new();
    for (name, case) in own {
        let mut table = common.clone();
        match case {
            Value::Mapping(case) => {
                if case.contains_key("settings") {
                    table.remove("more_settings");
                }
                table.extend(case);
            }
            steps => table.extend([("steps".into(), steps)]),
        }
        let each = table.remove("each").map_or_else(|| Ok(vec![BTreeMap::new()]), yaml_serde::from_value)?;
        for row in each.into_iter().flat_map(combinations) {
            let mut case: Case = yaml_serde::from_value(filled(&Value::Mapping(table.clone()), &row))?;
            let told: Vec<String> = row.iter().map(|(key, value)| format!("{key} {value}")).collect();
            let told = if told.is_empty() { String::new() } else { format!(" ({})", told.join(", ")) };
            case.name = text_of(&name) + &told;
            case.settings = spread(&[&case.settings, &case.more_settings]);
            case.steps = spread(&[&case.first, &case.steps, &case.last]);
            cases.push(case);
        }
    }
    Ok(cases)
}

/// The lines of `texts`, one after the other.
fn spread(texts: &[&str]) -> String {
    texts.iter().flat_map(|text| text.lines()).flat_map(each).map(|line| line + "\n").collect()
}

/// A row of keys and texts for each combination of the values of those keys that have a list of them.
fn combinations(row: BTreeMap<String, Value>) -> Vec<Vec<(String, String)>> {
    row.into_iter().fold(vec![vec![]], |rows, (key, value)| {
        let values = if let Value::Sequence(values) = value { values } else { vec![value] };
        let longer = |row: &Vec<_>, value| [&row[..], &[(key.clone(), text_of(value))]].concat();
        rows.iter().flat_map(|row| values.iter().map(move |value| longer(row, value))).collect()
    })
}

fn text_of(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => number.to_string(),
        other => panic!("{other:?} is neither a text nor a number"),
    }
}

/// `value` with the texts of `row` wherever it has their keys in braces.
fn filled(value: &Value, row: &[(String, String)]) -> Value {
    match value {
        Value::String(text) => {
            let fill =
                |text: String, (key, with): &(String, String)| text.replace(&format!("{{{key}}}"), with);
            Value::String(row.iter().fold(text.clone(), fill))
        }
        Value::Sequence(values) => values.iter().map(|value| filled(value, row)).collect(),
        Value::Mapping(table) => {
            let filled = |(key, value)| (key, filled(&value, row));
            Value::Mapping(table.iter().flat_map(|(key, value)| entries(key, value)).map(filled).collect())
        }
        other => other.clone(),
    }
}

/// The entries that one stands for whose key has a list such as `{1-3 5}`: that of each number `n`.
fn entries(key: &Value, value: &Value) -> Vec<(Value, Value)> {
    let split = |key: &str| {
        let (before, rest) = key.split_once('{')?;
        let (list, after) = rest.split_once('}')?;
        let entry = |n: String| (format!("{before}{n}{after}").into(), filled(value, &[("n".to_owned(), n)]));
        Some(items(list).map(entry).collect())
    };
    key.as_str().and_then(split).unwrap_or_else(|| vec![(key.clone(), value.clone())])
}
