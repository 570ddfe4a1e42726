//! The examples run to their end by themselves, and print what they should.

use std::process::Command;

#[test]
fn digital_io_reaches_op_and_its_inputs_follow_its_outputs() {
    // Of the workspace: for the package alone its dependencies would be compiled once more.
    let mut cargo = Command::new(env!("CARGO"));
    let built =
        cargo.args(["build", "--quiet", "--offline", "--workspace", "--example", "digital_io"]).status();
    assert!(built.unwrap().success());
    let deps = std::env::current_exe().unwrap();
    let output = Command::new(deps.with_file_name("../examples/digital_io")).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let printed = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<_> = printed.lines().collect();
    // An exchange brings the inputs that the outputs before it made.
    assert_eq!(
        lines[1..4],
        ["out 00000010, in 11111110", "out 00000011, in 11111101", "out 00000100, in 11111100"]
    );
}
