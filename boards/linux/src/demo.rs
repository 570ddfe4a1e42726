//! The demo: an RS-485 bus inside the program, with three devices that respond at the speed of a real line.
//!
//! The wire and the devices are the simulator's, on the wall clock. no_demo.rs replaces this file without the feature `demo`.

use std::f32::consts::TAU;
use std::fmt::Write as _;
use std::path::Path;
use std::rc::Rc;
use std::str::FromStr;

use clap::Args;
use embassy_executor::Spawner;
use embassy_time::{Duration, Instant, Timer};
use mobgate::settings::{InterfaceName, LineSettings, Settings, TcpListen};
use mobgate_simulator::device::serve;
use mobgate_simulator::{Device, LineEnd, SimSerial, Wire};

use crate::tcp::{Listener, TcpSockets};
use crate::{ethercat, settings};

mod lines;

pub use lines::{Line, Lines};

/// The demo's part of the command line examples.
pub(crate) const EXAMPLES: &str = "  mobgate                              run the demo: simulated devices on
                                       Modbus TCP port 502 or 5020
  mobgate --demo ethercat              the same, also as an EtherCAT SubDevice
";

/// Name of the bus as a serial device.
const DEVICE: &str = "demo";
/// TCP ports to try if the user names none: the standard one, and one that needs no privilege.
const TCP_PORTS: [u16; 2] = [502, 5020];

/// Default network interface of the EtherCAT SubDevice.
const INTERFACE: &str = "ecat1";
/// The other end of the virtual cable.
const OTHER_END: &str = "ecat0";

/// Response time of the slow device.
const SLOW: Duration = Duration::from_millis(300);
/// Update interval of the meter.
const MEASURE_EVERY: Duration = Duration::from_millis(200);

/// Unit 1, a meter.
const METER: u8 = 1;
/// Unit 2, a board with eight relays, initially off.
const RELAYS: u8 = 2;
/// Unit 3, slow.
const LAZY: u8 = 3;

/// The demo's option.
#[derive(Debug, Args)]
pub struct Choice {
    /// Simulate a bus with three devices, the serial device `demo`; with
    /// `ethercat` also be an EtherCAT SubDevice with them, at the network
    /// interface ecat1 or INTERFACE
    #[arg(long, verbatim_doc_comment, conflicts_with = "check", value_name = "ethercat[=INTERFACE]", num_args = 0..=1, default_missing_value = "modbus")]
    pub demo: Option<DemoKind>,
}

impl Choice {
    /// Whether the demo brings its own settings, in place of a file's.
    pub(crate) fn has_settings(&self) -> bool {
        self.interface().is_some()
    }

    /// The network interface of the EtherCAT SubDevice.
    fn interface(&self) -> Option<&str> {
        match &self.demo {
            Some(DemoKind::Ethercat(name)) => Some(name.as_str()),
            Some(DemoKind::Modbus) | None => None,
        }
    }
}

/// What to demonstrate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DemoKind {
    /// Devices behind Modbus TCP.
    Modbus,
    /// The same, and an EtherCAT SubDevice at this network interface.
    Ethercat(InterfaceName),
}

impl FromStr for DemoKind {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.split_once('=').unwrap_or((text, INTERFACE)) {
            ("modbus", _) => Ok(Self::Modbus),
            ("ethercat", name) => {
                let name =
                    InterfaceName::try_from(name).map_err(|_| "an interface has 15 characters at most")?;
                Ok(Self::Ethercat(name))
            }
            _ => Err("expected ethercat or ethercat=INTERFACE, or nothing"),
        }
    }
}

/// Checks whether the demo can run here with these options.
pub(crate) fn check(demo: &Choice, config: Option<&Path>) -> Result<(), String> {
    if config.is_some() {
        return Err("--demo ethercat has its own settings: start it without --config".to_owned());
    }
    let Some(name) = demo.interface() else { return Ok(()) };
    // An explicit request must not fail silently later.
    ethercat::check(name).map_err(|fault| format!("--demo ethercat: {fault}\n{}", ethercat_needs(name)))
}

/// The demo's settings, on the first of its TCP ports that can be opened, or at `listen`; and the listener there.
pub(crate) fn start(
    demo: &Choice,
    listen: Option<TcpListen>,
    sockets: &TcpSockets,
) -> Result<(Settings, Vec<Rc<Listener>>), String> {
    let interface = demo.interface();
    let default = TCP_PORTS.map(|port| TcpListen { address: None, port });
    let candidates = listen.as_ref().map_or(&default[..], std::slice::from_ref);
    let mut faults = Vec::new();
    for at in candidates {
        match sockets.open(at) {
            Ok(listener) => {
                let ethercat = interface.map(ethercat_settings).unwrap_or_default();
                let settings = settings::parse(&(settings_text(at) + &ethercat))?;
                print!("{}", invitation(at));
                interface.into_iter().for_each(|name| print!("{}", ethercat_invitation(name)));
                return Ok((settings, vec![listener]));
            }
            Err(error) => faults.push(format!("TCP port {at}: {error}")),
        }
    }
    Err(faults.join("; "))
}

/// Starts the demo's devices if requested, or if there is no configuration; returns the host of the serial lines.
pub fn spawn(demo: &Choice, config: Option<&Path>, spawner: Spawner) -> Lines {
    let wanted = demo.demo.is_some() || config.is_none();
    let demo = wanted.then(Demo::default);
    let lines = Lines { demo: demo.as_ref().map(Demo::serial) };
    // Spawned once: the task slot is free.
    demo.into_iter().for_each(|demo| spawner.spawn(devices(demo).unwrap()));
    lines
}

#[embassy_executor::task]
async fn devices(demo: Demo) {
    demo.run().await
}

/// The bus with its devices.
struct Demo {
    host: LineEnd,
    devices: LineEnd,
    meter: Device,
    relays: Device,
    lazy: Device,
}

impl Default for Demo {
    fn default() -> Self {
        let wire = Wire::new();
        let tap = || wire.tap(LineSettings::DEFAULT);
        let relays = Device::new(RELAYS);
        relays.memory().coils.fill(false);
        let meter = Device::new(METER);
        let lazy = Device::new(LAZY).with_turnaround(SLOW);
        Self { host: tap(), devices: tap(), meter, relays, lazy }
    }
}

impl Demo {
    /// A serial host with the gateway's end of the bus as device [`DEVICE`].
    fn serial(&self) -> SimSerial {
        SimSerial::new().with(DEVICE, &self.host)
    }

    /// Runs the devices; never returns.
    async fn run(self) {
        let Self { devices, meter, relays, lazy, .. } = self;
        let living = serve(devices, vec![meter.clone(), relays, lazy]);
        embassy_futures::join::join(living, measure(meter)).await;
    }
}

/// Updates the meter's input and holding registers.
async fn measure(meter: Device) {
    let mut energy_kwh = 1_234.5;
    loop {
        let phase = Instant::now().as_millis() as f32 / 1_000.0 * TAU;
        let volts = 230.0 + 2.0 * (phase / 20.0).sin();
        let amperes = 5.0 + 3.0 * (phase / 7.0).sin();
        let watts = volts * amperes;
        energy_kwh += watts * MEASURE_EVERY.as_millis() as f32 / 3.6e9;
        let hertz = 50.0 + 0.02 * (phase / 11.0).sin();
        show(&meter, &[volts, amperes, watts, hertz, energy_kwh]);
        Timer::after(MEASURE_EVERY).await;
    }
}

/// Writes `values` into the first registers of both tables.
fn show(meter: &Device, values: &[f32]) {
    let mut memory = meter.memory();
    for (index, word) in values.iter().copied().flat_map(words).enumerate() {
        memory.input[index] = word;
        memory.holding[index] = word;
    }
}

/// The two registers of a float, high word first as in most meters.
fn words(value: f32) -> [u16; 2] {
    let bits = value.to_bits();
    [(bits >> 16) as u16, bits as u16]
}

/// The demo's settings: forwards all units from a TCP server at `listen` to the bus.
fn settings_text(listen: &TcpListen) -> String {
    let TcpListen { port, .. } = listen;
    format!(
        "mdns off\n\
         port bus serial {DEVICE} rtu client 19200 8E1\n\
         port P{port} tcp server {listen}\n\
         route P{port} * * * bus\n"
    )
}

/// Additional settings for the EtherCAT SubDevice: the meter and the relays are in the process image.
fn ethercat_settings(interface: &str) -> String {
    format!(
        "port ecat ethercat interface {interface}\n\
         route ecat * * * bus\n\
         slave 0 unit {METER} input 0 count 10 read 100ms\n\
         slave 1 unit {RELAYS} coil 0 count 8 read 100ms\n"
    )
}

/// Explains the requirements of an EtherCAT SubDevice at `interface`.
fn ethercat_needs(interface: &str) -> String {
    let mut text =
        "It needs an Ethernet interface that is up, and the right to open a raw socket there.".to_owned();
    if interface == INTERFACE {
        text += &format!(
            " A virtual cable will do:\n  \
             sudo ip link add {OTHER_END} type veth peer name {INTERFACE}\n  \
             sudo ip link set {OTHER_END} up\n  \
             sudo ip link set {INTERFACE} up"
        );
    }
    text
}

/// Suggests commands for the MainDevice's end of the cable.
fn ethercat_invitation(interface: &str) -> String {
    let master = if interface == INTERFACE { OTHER_END } else { "INTERFACE" };
    format!(
        "An EtherCAT SubDevice with the meter and the relays is at {interface}. A MainDevice at the other end finds it:\n  \
         python3 -m venv ecat && ecat/bin/pip install pysoem\n  \
         sudo ecat/bin/python3 -c 'import pysoem; m = pysoem.Master(); m.open(\"{master}\"); m.config_init(); \
         print([d.name for d in m.slaves])'\n"
    )
}

/// Suggests commands for another terminal.
fn invitation(listen: &TcpListen) -> String {
    let host = match listen.address {
        Some(address) if !address.is_unspecified() => address.to_string(),
        _ => "127.0.0.1".to_owned(),
    };
    let port = listen.port;
    let mut text =
        format!("Simulated devices respond on Modbus TCP port {port}. Try from another terminal:\n");
    for (meaning, options, value) in [
        ("a meter's V, A, W, Hz and kWh, float32", "-a 1 -t 3:float -B -r 1 -c 5 -1", ""),
        ("eight relays", "-a 2 -t 0 -r 1 -c 8 -1", ""),
        ("switch the first one on", "-a 2 -t 0 -r 1", " 1"),
        ("a device that takes 300 ms to respond", "-a 3 -t 4 -r 1 -c 2 -1", ""),
    ] {
        let command = format!("mbpoll -m tcp -p {port} {options} {host}{value}");
        // Writing to a String cannot fail.
        let _ = writeln!(text, "  # {meaning}\n  {command}");
    }
    let _ = writeln!(text, "Here, protect the meter from writes:\n  {}", protection(port));
    text
}

/// A line for the console that lets clients only read the meter.
fn protection(port: u16) -> String {
    format!("insert route 1 P{port} {METER} * * bus readonly")
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::DemoKind;
    use crate::cli::Options;

    #[test]
    fn the_demo_is_of_two_kinds() {
        let kind = |words: &[&str]| Options::try_parse_from(words).map(|options| options.demo.demo);
        let at = |name: &str| Some(DemoKind::Ethercat(name.try_into().unwrap()));
        assert_eq!(kind(&["mobgate"]).unwrap(), None);
        assert_eq!(kind(&["mobgate", "--demo", "--config", "x"]).unwrap(), Some(DemoKind::Modbus));
        assert_eq!(kind(&["mobgate", "--demo", "ethercat"]).unwrap(), at("ecat1"));
        assert_eq!(kind(&["mobgate", "--demo", "ethercat=eth1"]).unwrap(), at("eth1"));
        for bad in ["profinet", "ethercat=sixteen-letters0"] {
            assert!(kind(&["mobgate", "--demo", bad]).is_err(), "{bad}");
        }
    }
}
