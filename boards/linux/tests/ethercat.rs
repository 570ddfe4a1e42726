//! The program as an EtherCAT SubDevice at a network interface: SOEM brings it to Op, and interfaces come and go.

use std::fs;
use std::process::Command;
use std::time::{Duration, Instant};

use ethercat_esc::Command as Datagram;
use ethercat_esc::frame::{Builder, FRAME_BYTES_MAX, datagrams};
use ethercat_esc::interface::Interface;
use mobgate::fieldbus::long_device;
use mobgate_simulator::own_network::{
    MASTER_END, SEGMENT_END, in_own_network, ip, lay_cable, python, start_master, start_master_with,
};

use common::{PATIENCE, Program, example, mobgate, output, wait_for, with_console};

mod common;

/// Options of the demo's bus behind settings of a test's own, with a console.
const DEMO: [&str; 5] = ["--demo", "--config", "{folder}/mobgate.conf", "--socket", "{folder}/console"];

/// The settings of the documents' example, with the demo's meter and relays, at the cable.
fn meter_and_relays() -> String {
    example("ethercat-cell.md")
        .replace("/dev/ttyUSB0", "demo")
        .replace("tcp server 502", "tcp server 127.0.0.1:{port}")
        .replace("interface eth1", "interface ecs0")
}

/// The hash of a password.
const HASH: &str =
    "$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA";

/// A SubDevice at the cable, without devices.
const ALONE: &str = "port P502 tcp server 127.0.0.1:{port}\nport ecat ethercat interface ecs0\n";

/// What the console says to `line`.
fn console(program: &Program, line: &str) -> String {
    let mut command = mobgate();
    command.arg("console").arg("--socket").arg(program.socket()).args(line.split(' '));
    String::from_utf8(command.output().unwrap().stdout).unwrap()
}

/// Waits until the EtherCAT port's row of `show ports` ends with `status`.
fn becomes(program: &Program, status: &str) {
    wait_for(&format!("the port to be {status:?}: {}", console(program, "show ports")), || {
        let ports = console(program, "show ports");
        ports.lines().any(|line| line.starts_with("ecat ") && line.ends_with(status)).then_some(())
    });
}

/// Registers of the EEPROM interface: control and status, address, data.
const EEPROM_CONTROL: u16 = 0x0502;
const EEPROM_ADDRESS: u16 = 0x0504;
const EEPROM_DATA: u16 = 0x0508;

/// The MainDevice's end of the cable.
struct MainDevice(Interface);

impl MainDevice {
    fn new() -> Self {
        Self(Interface::open(MASTER_END).unwrap())
    }

    /// The frame as it comes back within `patience`.
    fn send(&self, frame: &[u8], patience: Duration) -> Option<Vec<u8>> {
        self.0.send(frame).unwrap();
        let start = Instant::now();
        while start.elapsed() < patience {
            if let Some(back) = self.receive() {
                return Some(back);
            }
            std::thread::sleep(Duration::from_micros(200)); // between two looks
        }
        None
    }

    /// A frame that has come.
    fn receive(&self) -> Option<Vec<u8>> {
        let mut frame = [0; FRAME_BYTES_MAX];
        let length = self.0.receive(&mut frame).ok()?;
        Some(frame[..length].to_vec())
    }

    /// Sends one datagram until it comes back; its data, and how many devices have taken it.
    fn ask(&self, command: Datagram, offset: u16, data: &[u8]) -> (Vec<u8>, u16) {
        let frame = Builder::default().device(command, 0, offset, data).build();
        let mut back = wait_for("the frame", || self.send(&frame, Duration::from_secs(1)));
        let datagram = datagrams(&mut back).next().unwrap();
        (datagram.data().to_vec(), datagram.counter())
    }

    /// The product code in the EEPROM.
    fn product(&self) -> u32 {
        self.eeprom(0x0a)
    }

    /// Two words of the EEPROM.
    fn eeprom(&self, word: u32) -> u32 {
        self.ask(Datagram::Bwr, EEPROM_ADDRESS, &word.to_le_bytes());
        self.ask(Datagram::Bwr, EEPROM_CONTROL, &[0x00, 0x01]);
        wait_for("the EEPROM", || {
            (self.ask(Datagram::Brd, EEPROM_CONTROL, &[0; 2]).0[1] < 0x80).then_some(())
        });
        u32::from_le_bytes(self.ask(Datagram::Brd, EEPROM_DATA, &[0; 4]).0.try_into().unwrap())
    }
}

#[test]
fn pysoem_reads_and_writes_devices_by_process_data_and_saves() {
    in_own_network("pysoem_reads_and_writes_devices_by_process_data_and_saves", || {
        let program = Program::with(&meter_and_relays(), &DEMO);
        assert!(console(&program, "edit port ecat on-loss clear").is_empty());
        let script = start_master("linux.py", &["save".to_owned()]).wait().unwrap();
        assert!(script.success(), "the MainDevice's script: {script}\n{}", program.log());
        let kept = fs::read_to_string(program.config()).unwrap();
        assert!(kept.contains("interface ecs0 on-loss clear"), "{kept}");
        let ports = console(&program, "show ports");
        assert!(ports.contains("ecat            ethercat     ecs0"), "{ports}");
        assert!(console(&program, "show version").contains("EtherCAT controller present"));
    });
}

#[test]
fn pysoem_reads_the_settings_changes_a_rule_and_writes_them_back() {
    in_own_network("pysoem_reads_the_settings_changes_a_rule_and_writes_them_back", || {
        let user = format!("user anna role engineer password \"{HASH}\"\n");
        let settings = meter_and_relays().replace("ecs0\n", "ecs0 files write\n");
        let settings = user + &settings.replace("route ecat * ", "# by hand\nroute ecat 1-247 ");
        let program = Program::with(&settings, &DEMO);
        let document = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/ethercat.md");
        let script = start_master("settings.py", &[document.to_owned()]).wait().unwrap();
        assert!(script.success(), "the MainDevice's script: {script}\n{}", program.log());
        let kept = fs::read_to_string(program.config()).unwrap();
        assert!(kept.contains("# by hand\nroute ecat 2-100"), "{kept}");
        assert!(kept.contains(HASH), "{kept}");
        let audit = console(&program, "show audit");
        for what in ["+ route ecat 2-100", "mobgate.conf is in force and saved", "mobgate.conf is refused"] {
            let line = audit.lines().find(|line| line.contains(what)).expect(&audit);
            assert!(line.contains(" EtherCAT "), "{line}");
        }
        assert!(console(&program, "versions").contains("EtherCAT"));
    });
}

#[test]
fn pysoem_exchanges_images_that_a_controller_of_4_kib_would_not_hold() {
    in_own_network("pysoem_exchanges_images_that_a_controller_of_4_kib_would_not_hold", || {
        // Between meter and relays, whom nobody responds for: 600 bytes each way.
        let silent = "slave 1 unit 9 holding 0 count 300 read 1h\nslave 2 ";
        let program = Program::with(&meter_and_relays().replace("slave 1 ", silent), &DEMO);
        let script = start_master("linux.py", &["long".to_owned()]).wait().unwrap();
        assert!(script.success(), "the MainDevice's script: {script}\n{}", program.log());
    });
}

#[test]
fn an_interface_that_is_missing_down_or_taken_away_is_named_and_used_when_it_is_there() {
    let test = "an_interface_that_is_missing_down_or_taken_away_is_named_and_used_when_it_is_there";
    in_own_network(test, || {
        let counted = |master: &MainDevice| assert_eq!(master.ask(Datagram::Brd, 0, &[0]), (vec![0x04], 1));
        let program = with_console(&ALONE.replace("ecs0", "ecs7"));
        becomes(&program, "failed (no network interface is called ecs7: see ip link)");
        assert!(console(&program, "show version").contains("EtherCAT controller missing"));
        program.logs("EtherCAT controller missing: no network interface is called ecs7");
        assert!(console(&program, "edit port ecat interface lo").is_empty());
        becomes(&program, "failed (lo is not an Ethernet interface)");

        assert!(console(&program, &format!("edit port ecat interface {SEGMENT_END}")).is_empty());
        becomes(&program, "open");
        counted(&MainDevice::new());
        ip(&format!("link set {SEGMENT_END} down"));
        becomes(&program, "failed (the interface ecs0 is down: sudo ip link set ecs0 up)");
        ip(&format!("link set {SEGMENT_END} up"));
        becomes(&program, "open");
        counted(&MainDevice::new());
        // Both ends go.
        ip(&format!("link delete {MASTER_END}"));
        becomes(&program, "failed (no network interface is called ecs0: see ip link)");
        lay_cable();
        becomes(&program, "open");
        counted(&MainDevice::new());

        // Where there is no port there is no SubDevice.
        assert!(console(&program, "delete port ecat").is_empty());
        let frame = Builder::default().device(Datagram::Brd, 0, 0, &[0]).build();
        let master = MainDevice::new();
        let silent = || master.send(&frame, Duration::from_millis(100)).is_none().then_some(());
        wait_for("silence", silent);
        assert!(!console(&program, "show version").contains("EtherCAT"));
    });
}

#[test]
fn the_eeprom_is_that_of_the_device_with_or_without_modules_as_the_port_is_set() {
    let test = "the_eeprom_is_that_of_the_device_with_or_without_modules_as_the_port_is_set";
    in_own_network(test, || {
        let program = with_console(ALONE);
        becomes(&program, "open");
        let master = MainDevice::new();
        let [fixed, modular] = [false, true].map(|modules| long_device(modules, false).identity.product);
        assert_ne!(fixed, modular);
        assert_eq!(master.product(), fixed);
        for (words, product) in [("modules", modular), ("no-modules", fixed), ("modules", modular)] {
            assert!(console(&program, &format!("edit port ecat {words}")).is_empty());
            wait_for(words, || (master.product() == product).then_some(()));
            becomes(&program, "open");
        }
    });
}

#[test]
fn frames_of_others_and_of_this_machine_are_left_alone_and_malformed_ones_are_counted() {
    let test = "frames_of_others_and_of_this_machine_are_left_alone_and_malformed_ones_are_counted";
    in_own_network(test, || {
        let program = with_console(ALONE);
        becomes(&program, "open");
        let master = MainDevice::new();
        assert_eq!(master.ask(Datagram::Bwr, 0x0010, &[1, 0]).1, 1);
        // Sent out of the SubDevice's own interface by another program, it is not for the SubDevice.
        let neighbour = Interface::open(SEGMENT_END).unwrap();
        let outgoing = Builder::default().device(Datagram::Bwr, 0, 0x0010, &[2, 0]).build();
        neighbour.send(&outgoing).unwrap();
        assert_eq!(wait_for("the neighbour's frame", || master.receive()), outgoing);
        assert_eq!(master.ask(Datagram::Brd, 0x0010, &[0, 0]).0, [1, 0], "the neighbour was not heard");

        let whole = Builder::default().device(Datagram::Bwr, 0, 0x0010, &[3, 0]).build();
        let mut other = whole.clone();
        other[12..14].copy_from_slice(&[0x08, 0x00]);
        let mut long = whole.clone();
        long[22] = 0xFF;
        let mut kind = whole.clone();
        kind[15] |= 0x50;
        for (frame, malformed) in
            [(&other, false), (&long, true), (&kind, true), (&whole[..15].to_vec(), true)]
        {
            assert_eq!(master.send(frame, Duration::from_millis(50)), None, "malformed: {malformed}");
        }
        assert_eq!(master.ask(Datagram::Brd, 0x0010, &[0, 0]).0, [1, 0], "none of them did anything");
        let stats = console(&program, "show stats");
        let count = stats.lines().find(|line| line.starts_with("ecat ") && line.contains(" malformed "));
        let count = count.and_then(|line| line.split_whitespace().nth(2)).expect(&stats);
        assert_eq!(count, "3");
        assert_eq!(master.send(&whole, PATIENCE).map(|frame| frame[6] & 2), Some(2), "it goes on");
    });
}

#[test]
fn without_the_right_to_a_raw_socket_it_says_which_one_is_missing() {
    let test = "without_the_right_to_a_raw_socket_it_says_which_one_is_missing";
    in_own_network(test, || {
        let mut command = Command::new("setpriv");
        command.args(["--bounding-set", "-net_raw", env!("CARGO_BIN_EXE_mobgate")]);
        let program = Program::by(&mut command, ALONE, &DEMO[1..]);
        program.logs("a raw socket needs CAP_NET_RAW: sudo setcap cap_net_raw,cap_net_bind_service=+ep");
        assert!(console(&program, "show ports").contains("failed (a raw socket needs CAP_NET_RAW"));
    });
}

/// The demo's meter, by Modbus TCP and through EtherCAT.
const METER_BY_ETHERNET: &str = "\
port bus serial demo rtu client 19200 8E1
port P502 tcp server 127.0.0.1:{port}
port P1502 tcp server 1502
port ecat ethercat interface ecs0 ethernet eoe0
route P1502 * * * bus
route ecat * * * bus
slave 0 unit 1 input 0 count 10 read 100ms
";

#[test]
fn mbpoll_reads_a_device_through_the_virtual_adapter_of_soemx_while_process_data_are_exchanged() {
    let test = "mbpoll_reads_a_device_through_the_virtual_adapter_of_soemx_while_process_data_are_exchanged";
    in_own_network(test, || {
        let program = Program::with(METER_BY_ETHERNET, &DEMO);
        becomes(&program, "open");
        let read = "mbpoll -m tcp -p 1502 -a 1 -t 3 -0 -r 0 -c 10 -1 -o 5 10.7.0.2";
        let words: Vec<String> = ["20", "10"].into_iter().chain(read.split(' ')).map(str::to_owned).collect();
        let script = start_master_with("soemx", "adapter.py", &words).wait().unwrap();
        assert!(script.success(), "the MainDevice's script: {script}\n{}", program.log());
        program.logs("eoe0: addresses of the MainDevice: 10.7.0.2/24");
    });
}

#[test]
fn a_tap_interface_is_made_and_ends_as_the_settings_say_and_a_missing_right_is_named() {
    let test = "a_tap_interface_is_made_and_ends_as_the_settings_say_and_a_missing_right_is_named";
    in_own_network(test, || {
        let exists = |name: &str| fs::read_to_string("/proc/net/dev").unwrap().contains(&format!("{name}:"));
        let program = with_console(ALONE);
        becomes(&program, "open");
        let master = MainDevice::new();
        for (words, tap) in
            [("ethernet eoe0", Some("eoe0")), ("ethernet eoe1", Some("eoe1")), ("ethernet none", None)]
        {
            assert!(console(&program, &format!("edit port ecat {words}")).is_empty());
            wait_for(words, || {
                let found = ["eoe0", "eoe1"].map(exists);
                (found == ["eoe0", "eoe1"].map(|name| Some(name) == tap)).then_some(())
            });
            // The mailbox protocols in the EEPROM: EoE, CoE and FoE.
            let protocols = if tap.is_some() { 0x0e } else { 0x0c };
            wait_for(words, || (master.eeprom(0x1c) & 0xff == protocols).then_some(()));
            becomes(&program, "open");
        }
        assert!(console(&program, "edit port ecat ethernet lo").is_empty());
        becomes(&program, "failed (lo is not a TAP interface: name another one)");
        drop(program);

        let without_the_right = |tap: &str| {
            let mut command = Command::new("setpriv");
            command.args(["--bounding-set", "-net_admin", env!("CARGO_BIN_EXE_mobgate")]);
            Program::by(&mut command, &ALONE.replace("ecs0", &format!("ecs0 ethernet {tap}")), &DEMO[1..])
        };
        let program = without_the_right("eoe0");
        program.logs("a TAP interface needs CAP_NET_ADMIN: sudo setcap cap_net_admin,cap_net_raw");
        assert!(console(&program, "show ports").contains("failed (a TAP interface needs CAP_NET_ADMIN"));
        drop(program);

        // One that was made for the program's user.
        ip("tuntap add dev eoe2 mode tap user 0");
        let program = without_the_right("eoe2");
        program.logs("eoe2: the MAC address stays as it is: a TAP interface needs CAP_NET_ADMIN");
        becomes(&program, "open");
    });
}

/// The script of docs/ethercat-on-linux.md.
fn script_of_the_documentation() -> &'static str {
    let page = include_str!("../../../docs/ethercat-on-linux.md");
    page.split_once("```python\n").and_then(|(_, rest)| rest.split_once("```")).unwrap().0
}

#[test]
fn the_demo_is_a_sub_device_that_the_documentations_script_reads() {
    in_own_network("the_demo_is_a_sub_device_that_the_documentations_script_reads", || {
        let options = ["--demo", "ethercat=ecs0", "--listen", "127.0.0.1:{port}", "--socket", "off"];
        let program = Program::with("", &options);
        let script = program.file("meter.py");
        fs::write(&script, script_of_the_documentation()).unwrap();
        program.logs("An EtherCAT SubDevice with the meter and the relays is at ecs0.");
        // SOEM waits for a frame for 2 ms while it starts, and a busy machine may take longer: then it is started again.
        wait_for("the script to show volts and a relay", || {
            let output = Command::new(python("pysoem")).arg(&script).arg(MASTER_END).output().unwrap();
            let said = String::from_utf8(output.stdout).unwrap();
            println!("{said}{}{}", String::from_utf8_lossy(&output.stderr), program.log());
            let (volts, rest) = said.lines().last()?.split_once(" V")?;
            let good = (227.0..233.0).contains(&volts.parse::<f32>().ok()?);
            let one_relay = rest.split_once("relays ")?.1.matches('1').count() == 1;
            (output.status.success() && good && one_relay).then_some(())
        });
    });
}

#[test]
fn the_demo_says_what_it_needs_where_it_cannot_be_a_sub_device() {
    let refusal = |words: &[&str]| {
        let output = output(words);
        assert_eq!(output.status.code(), Some(1));
        assert_eq!(String::from_utf8(output.stdout).unwrap(), "", "it does not look as if it ran");
        String::from_utf8(output.stderr).unwrap()
    };
    // Where there is no ecat1.
    in_own_network("the_demo_says_what_it_needs_where_it_cannot_be_a_sub_device", || {
        let said = refusal(&["--demo", "ethercat", "--socket", "off"]);
        for part in [
            "--demo ethercat: no network interface is called ecat1",
            "sudo ip link add ecat0 type veth peer name ecat1",
            "sudo ip link set ecat1 up",
        ] {
            assert!(said.contains(part), "{part:?} is not in {said:?}");
        }
        let said = refusal(&["--demo", "ethercat=lo", "--socket", "off"]);
        assert!(said.contains("lo is not an Ethernet interface") && !said.contains("ecat0"), "{said}");
        let said = refusal(&["--demo", "ethercat", "--config", "/dev/null", "--socket", "off"]);
        assert!(said.contains("start it without --config"), "{said}");
    });
}
