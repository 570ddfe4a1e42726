//! A real MainDevice on simple devices, whose chips answer state requests by themselves, and what Wireshark makes of it.

use std::io::Write;
use std::process::Command;

use mobgate_simulator::esc::cable::{Cable, FrameFaults, SharedSegment};
use mobgate_simulator::esc::master::{Storage, main_device, pump};
use mobgate_simulator::esc::pcap::Pcap;
use mobgate_simulator::esc::{Segment, now};

use mobgate_simulator::esc::samples::simple_device;

use crate::prelude::*;

const FRAME: Duration = Duration::from_micros(50);
const CYCLES: u8 = 100;

/// Three devices with two bytes of outputs and two of inputs each.
fn three() -> SharedSegment {
    let chips = (0..3).map(|_| Chip::new(Kind::ET1100, simple_device()));
    Rc::new(RefCell::new(Segment::new(chips)))
}

/// Brings the devices at the cable to OP and exchanges process data; the first device's last inputs.
fn to_op(segment: &SharedSegment, prepare: impl FnOnce(Cable) -> Cable) -> Vec<u8> {
    let storage = Storage::new();
    let (tx, rx, pdu_loop) = storage.try_split().unwrap();
    let mut world = World::new(7);
    let cable = prepare(Cable::new(segment.clone(), FRAME));
    world.spawn(pump(tx, rx, cable));
    let master = main_device(pdu_loop, 20);
    world.run_until(async {
        let clock = || Instant::now().as_micros() * 1_000;
        let group = master.init_single_group::<4, 64>(clock).await.expect("init");
        assert_eq!(group.len(), 3);
        let group = group.into_op(&master).await.expect("op");
        segment.borrow().chip(0).borrow_mut().write(now(), 0x1100, &[0, 0x40]);
        for cycle in 0..CYCLES {
            group.subdevice(&master, 0).unwrap().outputs_raw_mut().copy_from_slice(&[cycle, !cycle]);
            group.tx_rx(&master).await.expect("exchange");
        }
        group.subdevice(&master, 0).unwrap().inputs_raw().to_vec()
    })
}

#[test]
fn ethercrab_brings_simple_devices_to_op() {
    let segment = three();
    assert_eq!(to_op(&segment, |cable| cable), [0, 0x40]);
    let chip = segment.borrow().chip(0);
    assert_eq!(chip.borrow().peek::<2>(0x0130), [8, 0]);
    let mut outputs = [0; 2];
    chip.borrow_mut().read(0, 0x1000, &mut outputs);
    assert_eq!(outputs, [CYCLES - 1, !(CYCLES - 1)]);
}

#[test]
fn a_line_with_faults_is_brought_to_op_all_the_same() {
    let faults = FrameFaults { lost: 0.02, corrupt: 0.02, doubled: 0.02, delayed: 0.02, delay_us: 1..=200 };
    let random = mobgate_simulator::Random::new(3);
    assert_eq!(to_op(&three(), |cable| cable.with_faults(faults, random)), [0, 0x40]);
}

/// A capture that a test can look at when the cable that wrote it is gone.
#[derive(Clone, Default)]
pub(crate) struct Capture(Rc<RefCell<Vec<u8>>>);

impl Write for Capture {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.borrow_mut().write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Capture {
    /// What a cable writes to.
    pub(crate) fn pcap(&self) -> Pcap<Box<dyn Write>> {
        Pcap::new(Box::new(self.clone()) as Box<dyn Write>).unwrap()
    }

    /// What tshark makes of it: frames, those that are EtherCAT, and a line for each malformed one.
    pub(crate) fn decode(&self) -> (usize, usize, Vec<String>) {
        let thread = std::thread::current().id();
        let path = std::env::temp_dir().join(format!("mobgate-{}-{thread:?}.pcap", std::process::id()));
        std::fs::write(&path, self.0.borrow().as_slice()).unwrap();
        let tshark = |filter: &str| {
            let output = Command::new("tshark").args(["-n", "-r"]).arg(&path).args(["-Y", filter]).output();
            let output = output.expect("tshark is installed: apt-get install tshark");
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect::<Vec<_>>()
        };
        let malformed = tshark("_ws.malformed || _ws.expert.severity >= warning");
        let decoded = (tshark("frame").len(), tshark("ecat").len(), malformed);
        std::fs::remove_file(&path).unwrap();
        decoded
    }
}

#[test]
fn tshark_decodes_a_capture_without_malformed_packets() {
    let capture = Capture::default();
    to_op(&three(), |cable| cable.with_capture(capture.pcap()));
    let (frames, ethercat, malformed) = capture.decode();
    assert!(frames > 2 * usize::from(CYCLES), "{frames} frames");
    assert_eq!(frames, ethercat, "all of them EtherCAT");
    assert_eq!(malformed, [] as [String; 0]);
}
