//! What is written about the EtherCAT side is true: the table of statements, and that it stands alone.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// All files with Rust sources in `folder` and below.
fn sources(folder: &Path) -> Vec<(PathBuf, String)> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let (folders, files): (Vec<_>, Vec<_>) = entries.partition(|path| path.is_dir());
    let rust = files.into_iter().filter(|path| path.extension().is_some_and(|extension| extension == "rs"));
    let read = rust.map(|path| (path.clone(), fs::read_to_string(path).unwrap()));
    read.chain(folders.iter().flat_map(|folder| sources(folder))).collect()
}

fn root(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

#[test]
fn each_statement_that_is_passed_has_a_test_and_each_such_test_is_in_the_table() {
    let files = ["tests/ethercat", "ethercat/emulator/tests"].map(|path| sources(&root(path))).concat();
    let tested: BTreeSet<String> = files
        .iter()
        .flat_map(|(_, text)| text.split("fn statement_").skip(1))
        .map(|name| name.split_at(2).0.to_owned())
        // Here the words stand without a number.
        .filter(|number| number.parse::<u8>().is_ok())
        .collect();
    let table = fs::read_to_string(root("docs/conformance.md")).unwrap();
    let rows = table.lines().filter_map(|line| line.strip_prefix("| "));
    let passed: BTreeSet<String> =
        rows.filter(|row| row.ends_with("| passed |")).map(|row| row.split_at(2).0.to_owned()).collect();
    assert_eq!(passed, tested);
}

#[test]
fn the_sub_device_and_its_controllers_know_nothing_of_modbus() {
    let crates = ["ethercat/subdevice/src", "ethercat/emulator/src"].map(|path| sources(&root(path)));
    assert!(crates.iter().all(|files| files.len() > 20));
    for (path, text) in crates.into_iter().flatten() {
        assert!(!text.contains("odbus"), "{}", path.display());
    }
}
