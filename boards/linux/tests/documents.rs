//! The documents' settings are good for the program.

use std::io::Write;
use std::path::Path;
use std::process::Command;

#[path = "../../../tests/gateway/documents/blocks.rs"]
mod blocks;

use blocks::{Block, blocks};

#[test]
fn settings_in_the_documents_pass_check() {
    let mut wrong = Vec::new();
    for Block { place, with, lines, .. } in
        blocks(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."), "settings")
    {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        writeln!(file, "{}", [with, lines].concat().join("\n")).unwrap();
        let check =
            Command::new(env!("CARGO_BIN_EXE_mobgate")).arg("--check").arg(file.path()).output().unwrap();
        if !check.status.success() {
            wrong.push(format!("{place}: {}", String::from_utf8_lossy(&check.stderr)));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
