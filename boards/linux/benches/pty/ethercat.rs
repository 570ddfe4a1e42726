//! How long an EtherCAT frame stays in the program, and how many are lost: SOEM exchanges process data with it by a pair of virtual
//! interfaces, in a network namespace that this group makes.
//!
//! ```text
//! pysoem, 1 ms --> ecm0 ==== ecs0 --> mobgate
//!                            ^ the kernel's time stamps, on the way in and on the way out
//! ```

use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread;
use std::time::Duration;

use mobgate_simulator::own_network::{again, is_inside, prepare, start_master};

use crate::Effort;
use crate::common::Program;
use crate::figure::{Target, figure};
use crate::statistics::percentile;
use tap::{Passages, Tap};

mod tap;

const LENGTH_MS: u64 = 20_000;
/// The demo's meter and relays.
const SETTINGS: &str = "\
port bus serial demo rtu client 19200 8E1
port P502 tcp server 127.0.0.1:{port}
port ecat ethercat interface ecs0
route ecat * * * bus
slave 0 unit 1 input 0 count 10 read 100ms
slave 1 unit 2 coil 0 count 8 read 100ms
";

/// Prints the figures.
pub(crate) fn figures(effort: Effort) {
    if is_inside() {
        prepare();
        return print(passages(effort.length(LENGTH_MS)));
    }
    let quick = effort.quick.then_some("--quick");
    let status = again().arg("ethercat").args(quick).status();
    assert!(status.expect("unshare is installed: apt-get install util-linux").success());
}

/// What passed the program's interface while pysoem exchanged process data with it for so long.
fn passages(length: Duration) -> Passages {
    let options = ["--demo", "--config", "{folder}/mobgate.conf", "--socket", "off"];
    let program = Program::with(SETTINGS, &options);
    program.logs("EtherCAT controller present");
    let over = Arc::new(AtomicBool::new(false));
    let seen = over.clone();
    let tap = Tap::open();
    let watching = thread::spawn(move || tap.watch(&seen));
    let script = start_master("cycles.py", &[length.as_secs().to_string()]).wait().unwrap();
    assert!(script.success(), "the MainDevice's script: {script}\n{}", program.log());
    thread::sleep(Duration::from_millis(200)); // for what is still on its way to the tap
    over.store(true, Relaxed);
    watching.join().unwrap()
}

fn print(Passages { added, lost }: Passages) {
    let load = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    println!("{} frames with process data; load average {load}", added.len());
    let us = |part| percentile(added.clone(), part).map_or(f64::NAN, |time| time.as_secs_f64() * 1e6);
    figure("ethercat_interface_lost", lost as f64, "frames", Target::AtMost(0.0));
    figure("ethercat_interface_added_p50", us(0.5), "us", Target::None);
    figure("ethercat_interface_added_p99", us(0.99), "us", Target::AtMost(300.0));
    figure("ethercat_interface_added_max", us(1.0), "us", Target::None);
}
