//! The demo: an RS-485 bus inside the program, with three devices that response at the speed of a real line.
//!
//! The wire and the devices are the simulator's, on the wall clock.

use std::f32::consts::TAU;
use std::fmt::Write as _;

use embassy_time::{Duration, Instant, Timer};
use mobgate::settings::{LineSettings, TcpListen};
use mobgate_simulator::device::serve;
use mobgate_simulator::{Device, LineEnd, SimSerial, Wire};

/// The bus's name among the serial devices.
pub const DEVICE: &str = "demo";
/// Ports that the demo tries when the user names none: Modbus TCP's own, and one that needs no privilege.
pub const TCP_PORTS: [u16; 2] = [502, 5020];

/// The network interface at which the demo is an EtherCAT SubDevice when the user names none.
pub const INTERFACE: &str = "ecat1";
/// The other end of the cable that leads there.
const OTHER_END: &str = "ecat0";

/// The slow device thinks that long.
const SLOW: Duration = Duration::from_millis(300);
/// How often the meter measures.
const MEASURE_EVERY: Duration = Duration::from_millis(200);

/// Unit 1, a meter.
const METER: u8 = 1;
/// Unit 2, a board with eight relays, all off at first.
const RELAYS: u8 = 2;
/// Unit 3, slow.
const LAZY: u8 = 3;

/// The bus with its devices.
pub struct Demo {
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
    /// A serial host whose device [`DEVICE`] is the gateway's end of the bus.
    pub fn serial(&self) -> SimSerial {
        SimSerial::new().with(DEVICE, &self.host)
    }

    /// Lets the devices live, for ever.
    pub async fn run(self) {
        let Self { devices, meter, relays, lazy, .. } = self;
        let living = serve(devices, vec![meter.clone(), relays, lazy]);
        embassy_futures::join::join(living, measure(meter)).await;
    }
}

/// Keeps the meter's registers moving, in the input and in the holding table.
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

/// A float's two registers, the high word first as most meters have it.
fn words(value: f32) -> [u16; 2] {
    let bits = value.to_bits();
    [(bits >> 16) as u16, bits as u16]
}

/// The demo's settings: all units behind the bus, for clients of a TCP server at `listen`.
pub fn settings_text(listen: &TcpListen) -> String {
    let TcpListen { port, .. } = listen;
    format!(
        "mdns off\n\
         port bus serial {DEVICE} rtu client 19200 8E1\n\
         port P{port} tcp server {listen}\n\
         route P{port} * * * bus\n"
    )
}

/// The settings that make it an EtherCAT SubDevice as well: the meter and the relays are in the process image.
pub fn ethercat_settings(interface: &str) -> String {
    format!(
        "port ecat ethercat interface {interface}\n\
         route ecat * * * bus\n\
         slave 0 unit {METER} input 0 count 10 read 100ms\n\
         slave 1 unit {RELAYS} coil 0 count 8 read 100ms\n"
    )
}

/// What it takes to be an EtherCAT SubDevice at `interface`.
pub fn ethercat_needs(interface: &str) -> String {
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

/// What to type at the MainDevice's end of the cable.
pub fn ethercat_invitation(interface: &str) -> String {
    let master = if interface == INTERFACE { OTHER_END } else { "INTERFACE" };
    format!(
        "An EtherCAT SubDevice with the meter and the relays is at {interface}. A MainDevice at the other end finds it:\n  \
         python3 -m venv ecat && ecat/bin/pip install pysoem\n  \
         sudo ecat/bin/python3 -c 'import pysoem; m = pysoem.Master(); m.open(\"{master}\"); m.config_init(); \
         print([d.name for d in m.slaves])'\n"
    )
}

/// What to type into another terminal.
pub fn invitation(listen: &TcpListen) -> String {
    let host = match listen.address {
        Some(address) if !address.is_unspecified() => address.to_string(),
        _ => "127.0.0.1".to_owned(),
    };
    let port = listen.port;
    let mut text =
        format!("Simulated devices answer on Modbus TCP port {port}. Try from another terminal:\n");
    for (meaning, options, value) in [
        ("a meter's V, A, W, Hz and kWh, float32", "-a 1 -t 3:float -B -r 1 -c 5 -1", ""),
        ("eight relays", "-a 2 -t 0 -r 1 -c 8 -1", ""),
        ("switch the first one on", "-a 2 -t 0 -r 1", " 1"),
        ("a device that takes 300 ms to answer", "-a 3 -t 4 -r 1 -c 2 -1", ""),
    ] {
        let command = format!("mbpoll -m tcp -p {port} {options} {host}{value}");
        // Writing to a String cannot fail.
        let _ = writeln!(text, "  # {meaning}\n  {command}");
    }
    text
}
