//! mbpoll asks: all data types that it reads and writes.

use crate::common::Program;
use crate::lines::{Line, program};
use crate::outside::Tool;

/// Runs mbpoll once against `program`; its words about values, or about what failed.
fn mbpoll(program: &Program, arguments: &str) -> Vec<String> {
    let port = program.port.to_string();
    let mut words = vec!["-m", "tcp", "-p", &port, "-o", "5", "-1"];
    words.extend(arguments.split_whitespace());
    let (_, said) = Tool::mbpoll().run(&words);
    let told = |line: &&str| line.starts_with('[') || line.starts_with("Written") || line.contains("failed:");
    said.lines().filter(told).map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect()
}

const ROUTE: &str = "route P502 101-132 * -100 P1
";

#[test]
fn mbpoll_reads_every_type() {
    let lines = [Line::with_pymodbus(&[1, 2])];
    let program = program(&lines, ROUTE);
    // mbpoll counts from 1: its register 8 is address 7, which holds 256 + 7.
    for (arguments, values) in [
        ("-a 101 -t 1 -r 1 -c 4 127.0.0.1", &["[1]: 1", "[2]: 0", "[3]: 0", "[4]: 1"][..]),
        ("-a 101 -t 3 -r 8 -c 2 127.0.0.1", &["[8]: 263", "[9]: 264"]),
        ("-a 101 -t 3:hex -r 8 -c 2 127.0.0.1", &["[8]: 0x0107", "[9]: 0x0108"]),
        ("-a 101 -t 3:int -B -r 8 -c 1 127.0.0.1", &["[8]: 17236232"]),
        ("-a 101 -t 3:float -r 8 -c 1 127.0.0.1", &["[8]: 2.498e-38"]),
        ("-a 101,102 -t 3 -r 1 -c 1 127.0.0.1", &["[1]: 256", "[1]: 512"]),
    ] {
        assert_eq!(mbpoll(&program, arguments), values, "{arguments}");
    }
}

#[test]
fn mbpoll_reads_what_it_wrote_in_every_type() {
    let lines = [Line::with_pymodbus(&[1])];
    let program = program(&lines, ROUTE);
    for (write, written, read, values) in [
        ("-t 0 -r 5 127.0.0.1 1 0 1", 3, "-t 0 -r 4 -c 4", &["[4]: 0", "[5]: 1", "[6]: 0", "[7]: 1"][..]),
        ("-t 0 -r 7 127.0.0.1 0", 1, "-t 0 -r 7 -c 1", &["[7]: 0"]),
        ("-t 4 -r 5 127.0.0.1 17", 1, "-t 4 -r 5 -c 1", &["[5]: 17"]),
        ("-t 4 -r 5 127.0.0.1 18 65535", 2, "-t 4:hex -r 5 -c 2", &["[5]: 0x0012", "[6]: 0xFFFF"]),
        ("-t 4:int -B -r 11 127.0.0.1 -- 99 -5", 2, "-t 4:int -B -r 11 -c 2", &["[11]: 99", "[13]: -5"]),
        ("-t 4:float -r 21 127.0.0.1 -- 3.25", 1, "-t 4:float -r 21 -c 1", &["[21]: 3.25"]),
        (
            "-t 4:float -B -r 23 127.0.0.1 -- -1.5",
            1,
            "-t 4:hex -r 23 -c 2",
            &["[23]: 0xBFC0", "[24]: 0x0000"],
        ),
    ] {
        assert_eq!(mbpoll(&program, &format!("-a 101 {write}")), [format!("Written {written} references.")]);
        assert_eq!(mbpoll(&program, &format!("-a 101 {read} 127.0.0.1")), values, "{read}");
    }
}

#[test]
fn mbpoll_shows_the_devices_exceptions_and_the_gateways_own() {
    let lines = [Line::with_rmodbus(1)];
    let program = program(&lines, ROUTE);
    for (arguments, exception) in [
        ("-a 101 -t 4 -r 1001 -c 1", "Illegal data address"),
        ("-a 102 -t 4 -r 1 -c 1", "Target device failed to respond"),
        ("-a 99 -t 4 -r 1 -c 1", "Gateway path unavailable"),
    ] {
        let said = mbpoll(&program, &format!("{arguments} 127.0.0.1"));
        assert_eq!(said, [format!("Read output (holding) register failed: {exception}")]);
    }
}
