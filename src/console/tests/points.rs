//! Sessions about data points.

use std::format;

use super::{Memory, Mode, new_gateway, pipe, session, std};

const POINTS: &str = "port scan scanner\ndevice meter unit 5\npoint power meter 40001 as f32 read manual write auto\n\
                      point kept local holding 7 count 3 as i16\npoint lamps local coil 0 count 4 label \"On, off\"\n\
                      point shown local input 0 of kept\npoint run meter holding 40 bit 3\n";

#[test]
fn points_are_written_and_shown_with_their_values() {
    let gateway = &new_gateway();
    assert_eq!(pipe(gateway, POINTS), "");
    let said = pipe(gateway, "write kept 1 -2 3\nwrite lamps at 1 on 0 1\nwrite shown at 2 0x10\n");
    let kept = "kept            local           holding       7   40008 0000h new; 0.0s old;";
    assert!(said.contains(&format!("{kept}\n  [0] 1 -2 3\n")), "{said}");
    assert!(said.contains("new; 0.0s old; On, off\n  [0] 0 1 0 1\n"), "{said}");
    assert!(said.ends_with(&format!("{kept}\n  [0] 1 -2 16\n")), "{said}");
    let table = pipe(gateway, "show points\n");
    assert!(table.starts_with("POINT"), "{table}");
    assert_eq!(table.matches("[0] 1 -2 16\n").count(), 2, "{table}");
    assert!(table.contains("power           meter           holding       0   40001 0000h new; never read;"));
    let run = pipe(gateway, "begin run\nwrite run on\n");
    assert!(
        run.starts_with("run             meter           holding    40.3   40041 0100h blocked;"),
        "{run}"
    );
    assert!(run.ends_with("\n  [0] 1\n"), "{run}");
    assert!(pipe(gateway, "show devices\n").contains("meter              5"));
}

#[test]
fn the_registers_of_the_own_unit_are_listed_with_the_names_of_ports_and_points() {
    let gateway = &new_gateway();
    pipe(gateway, POINTS);
    let registers = pipe(gateway, "show registers");
    for line in [
        "8000h input   gateway",
        "8100h input   port scan",
        "9000h input   units of port scan",
        "F000h holding command (input: status) of point power",
        "F003h holding command (input: status) of point shown",
        "F100h holding range of points: requester and device, function, first, count",
        "F110h holding commands by requester: under way, failed",
    ] {
        assert!(registers.contains(&format!("{line}\n")), "{registers}");
    }
    assert_eq!(registers.lines().count(), 11, "{registers}");
}

#[test]
fn what_cannot_be_done_with_a_point_is_said() {
    let gateway = &new_gateway();
    pipe(gateway, POINTS);
    for (line, error) in [
        ("read nobody", "column 6: \"nobody\": there is no point of this name"),
        ("read kept", "no device is read for it"),
        ("read power now", "column 12: \"now\": expected the end of the line"),
        ("write kept 1 2 3 4", "column 18: \"4\": expected no more values than the point has"),
        ("write kept at 3 1", "column 17: \"1\": expected no more values than the point has"),
        ("write kept at x 1", "column 15: \"x\": expected the number of a value, from 0"),
        ("write kept at 0", "column 16: end of line: expected a value of the point's type"),
        ("write kept 40000", "column 12: \"40000\": expected a value of the point's type"),
        ("write lamps 2", "column 13: \"2\": expected 0 or 1"),
        ("finish power", "no safe write has begun"),
        ("mark meter 7 0", "column 12: \"7\": expected a function: 1 to 4 to read, 5, 6, 15 or 16 to write"),
        ("mark meter 4 0", "there are no such cells"),
    ] {
        assert_eq!(pipe(gateway, line), format!("error: line 1, {error}\n"), "{line}");
    }
    assert_eq!(
        pipe(gateway, "begin power\nwrite power 1.5\nbegin power"),
        "power           meter           holding       0   40001 0180h to-write blocked; 0.0s old;\n  [0] 1.5\nerror: line 3, a safe write has begun\n"
    );
}

#[test]
fn a_line_that_stops_a_command_is_no_command_itself_however_long_it_is() {
    let gateway = &new_gateway();
    pipe(gateway, POINTS);
    let script = "watch points\nwhat stops a command needs no sense\nhelp exit\n";
    // As it comes from somebody who types the first line, and the second one when it is watched.
    let printed = session(gateway, &mut Memory::default(), Mode::Plain, script, 13);
    assert!(!printed.contains("error"), "{printed}");
    assert!(printed.ends_with("exit                          ends this session\n"), "{printed}");
}
