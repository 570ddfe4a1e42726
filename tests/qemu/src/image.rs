//! The board's image: built by the same command as by hand.

use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Mutex;

/// The repository's root.
pub fn root() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// What an image has besides what all have.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Image {
    /// What it has by default.
    #[default]
    Usual,
    /// The console by SSH, too.
    Ssh,
    /// Roles in rules, which nothing gives to a client there.
    Roles,
    /// The web interface with its page.
    Web,
}

/// The usual image of the QEMU board.
pub fn build() -> PathBuf {
    Image::Usual.build()
}

impl Image {
    /// The file with the image, built anew if anything has changed since this process began.
    pub fn build(self) -> PathBuf {
        static BUILT: Mutex<Vec<Image>> = Mutex::new(Vec::new());
        let (name, features): (_, &[&str]) = match self {
            Self::Usual => ("mobgate-qemu-mps2-usual", &[]),
            Self::Ssh => ("mobgate-qemu-mps2-ssh", &["--features", "ssh"]),
            Self::Roles => ("mobgate-qemu-mps2-roles", &["--features", "roles"]),
            Self::Web => ("mobgate-qemu-mps2-web", &["--features", "web"]),
        };
        let folder = root().join("target/thumb/thumbv7em-none-eabihf/release");
        let file = folder.join(name);
        // One at a time: all are built under the same name first.
        let mut built = BUILT.lock().unwrap();
        if !built.contains(&self) {
            compile(features);
            fs::copy(folder.join("mobgate-qemu-mps2"), &file).expect("the image");
            built.push(self);
        }
        file
    }
}

fn compile(features: &[&str]) {
    // Cargo's own settings of this run are not that build's.
    let own = std::env::vars_os().map(|(name, _)| name).filter(|name| {
        let name = name.to_string_lossy();
        name.starts_with("CARGO_") && name != "CARGO_HOME"
    });
    let mut command = Command::new("cargo");
    own.for_each(|name| {
        command.env_remove(name);
    });
    command.current_dir(root()).args(["xtask", "board", "qemu_mps2", "build"]).args(features);
    let built = command.status().expect("cargo");
    assert!(built.success(), "the image cannot be built");
}
