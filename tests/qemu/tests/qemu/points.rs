//! Data points and the frames of the lines, as on every board.

use mobgate_qemu::wait_for;

use crate::Bench;

#[test]
fn data_points_are_read_and_written_and_their_frames_are_shown() {
    let bench = Bench::new();
    let mut console = bench.machine.console();
    for line in [
        "port scan scanner",
        "route scan 1-64 * * P1",
        "device meter unit 2",
        "point power meter holding 0 count 3 read high",
        "point limit meter holding 9 read manual write auto",
    ] {
        assert_eq!(console.run(line), "", "{line}");
    }
    wait_for("the registers", || console.run("show points").contains("[0] 512 513 514").then_some(()));
    bench.buses[0].with(2, |memory| memory.holding[1] = 7);
    wait_for("the change", || console.run("show points").contains("[0] 512 7 514").then_some(()));
    console.run("write limit 4711");
    wait_for("the write", || (bench.buses[0].holding(2, 9) == 4711).then_some(()));
    let frames = console.run("show frames");
    assert!(frames.contains("02 03 00 00 00 03"), "the scanner's read: {frames}");
    assert!(frames.contains("02 03 06 02 00 00 07 02 02"), "its response: {frames}");
}
