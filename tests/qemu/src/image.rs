//! The board's image: built by the same command as by hand.

use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

/// The repository's root.
pub fn root() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// The image of the QEMU board, built anew if anything has changed.
pub fn build() -> PathBuf {
    static BUILT: OnceLock<()> = OnceLock::new();
    BUILT.get_or_init(|| {
        // Cargo's own settings of this run are not that build's.
        let own = std::env::vars_os().map(|(name, _)| name).filter(|name| {
            let name = name.to_string_lossy();
            name.starts_with("CARGO_") && name != "CARGO_HOME"
        });
        let mut command = Command::new("cargo");
        own.for_each(|name| {
            command.env_remove(name);
        });
        command.current_dir(root()).args(["xtask", "board", "qemu_mps2", "build"]);
        let built = command.status().expect("cargo");
        assert!(built.success(), "the image cannot be built");
    });
    root().join("target/thumb/thumbv7em-none-eabihf/release/mobgate-qemu-mps2")
}
