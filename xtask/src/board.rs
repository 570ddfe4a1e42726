//! Runs cargo for other processors. Only this file knows where their toolchain is: rustup's, if the target has been added; else
//! Debian's compiler, which ships the sources of the standard library, so that it is built along.

use std::path::{Path, PathBuf};
use std::process::Command;

use object::Endianness;
use object::elf::PT_LOAD;
use object::read::elf::{ElfFile32, ProgramHeader};

use crate::tools::{self, Outcome, command, output, root};

/// A Cortex-M4 or Cortex-M7 with FPU.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// Folder of the images: `target/thumb/...`.
pub(crate) fn images() -> PathBuf {
    root().join("target/thumb").join(TARGET).join("release")
}

/// The image of a board.
pub(crate) fn image(board: &str) -> PathBuf {
    images().join(format!("mobgate-{}", board.replace('_', "-")))
}

/// The STM32 boards: the folders `boards/nucleo_...`.
pub(crate) fn nucleos() -> Outcome<Vec<String>> {
    let folder = root().join("boards").read_dir().map_err(|error| format!("boards/: {error}"))?;
    let names = folder.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    let mut nucleos: Vec<String> = names.filter(|name| name.starts_with("nucleo_")).collect();
    nucleos.sort();
    Ok(nucleos)
}

/// Folder of the compiler that comes with the standard library's sources.
fn debian() -> PathBuf {
    std::env::var_os("DEBIAN_RUST").map_or("/usr/bin".into(), PathBuf::from)
}

/// Whether this compiler has a prebuilt core library for the target.
fn has_core() -> bool {
    let library = sysroot(Path::new("rustc")).map(|root| root.join("lib/rustlib").join(TARGET).join("lib"));
    let files = library.and_then(|folder| folder.read_dir().ok());
    files.is_some_and(|mut files| {
        files.any(|file| file.is_ok_and(|file| file.file_name().to_string_lossy().starts_with("libcore-")))
    })
}

/// Whether Debian's compiler is installed, with the standard library's sources.
pub(crate) fn has_sources() -> bool {
    let sources = sysroot(&debian().join("rustc"))
        .map(|root| root.join("lib/rustlib/src/rust/library/core/Cargo.toml"));
    debian().join("cargo").exists() && sources.is_some_and(|file| file.exists())
}

/// Whether a toolchain that builds and lints for a Cortex-M is installed.
pub(crate) fn has_toolchain() -> bool {
    has_core()
        || has_sources() && debian().join("clippy-driver").exists() && tools::program("ld.lld").is_some()
}

fn sysroot(rustc: &Path) -> Option<PathBuf> {
    let printed = Command::new(rustc).args(["--print", "sysroot"]).output().ok()?;
    Some(String::from_utf8(printed.stdout).ok()?.trim().into())
}

/// Debian's cargo, with unstable options enabled.
fn debian_cargo(arguments: &[&str]) -> Command {
    let mut cargo = command(debian().join("cargo"), arguments);
    let path = std::env::var_os("PATH").unwrap_or_default();
    let path = std::iter::once(debian()).chain(std::env::split_paths(&path));
    cargo.env("PATH", std::env::join_paths(path).unwrap_or_default()).env("RUSTC_BOOTSTRAP", "1");
    cargo.env_remove("RUSTUP_TOOLCHAIN");
    cargo
}

/// Runs a cargo command for a board, or for `core`, the gateway's core without a board.
pub(crate) fn run(board: &str, subcommand: &str, arguments: &[String]) -> Outcome {
    let core = board == "core";
    let folder = root().join("boards").join(board);
    if !core && !folder.join("Cargo.toml").exists() {
        return Err(format!("no board {board} in boards/"));
    }
    let (mut cargo, rustc) = if has_core() {
        (command("cargo", &[subcommand]), "rustc".into())
    } else if has_sources() {
        let mut cargo = debian_cargo(&[subcommand]);
        // Boards link crates that name `alloc` without using it; the core must do without.
        cargo.arg(if core { "-Zbuild-std=core" } else { "-Zbuild-std=core,alloc" });
        // rustup's compiler ships a linker, Debian's does not.
        cargo.env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", "ld.lld");
        (cargo, debian().join("rustc"))
    } else {
        return Err(format!(
            "no core library for {TARGET}: run 'rustup target add {TARGET}', or on Debian 'cargo xtask install thumb'"
        ));
    };
    // Settings of the host build do not apply; rustup's cargo passes its own compiler on.
    cargo.env_remove("RUSTC").env_remove("CARGO").env_remove("RUSTFLAGS");
    if core {
        cargo.args(["--package", "mobgate", "--lib", "--no-default-features"]);
    } else {
        // cargo finds .cargo/config.toml and the linker regions.x from the board's folder.
        cargo.current_dir(&folder);
    }
    // A separate target folder: sharing one would rebuild everything when switching compilers.
    cargo
        .args(["--locked", "--release", "--target", TARGET, "--target-dir"])
        .arg(root().join("target/thumb"));
    cargo.arg("--config").arg(short_paths()).args(arguments);
    // Sizes depend on the compiler.
    eprintln!("{board} for {TARGET} with {}", output(&mut command(rustc, &["--version"]))?.trim());
    tools::run(&mut cargo)?;
    match subcommand {
        "build" if core => tools::built(images().join("libmobgate.rlib")),
        "build" => {
            tools::built(image(board))?;
            tools::built(write_flat(&image(board))?)
        }
        _ => Ok(()),
    }
}

/// Writes the flash contents beside an image as a flat binary, for tools that do not read ELF.
fn write_flat(image: &Path) -> Outcome<PathBuf> {
    let fault = |path: &Path, what: &dyn std::fmt::Display| format!("{}: {what}", path.display());
    let elf = std::fs::read(image).map_err(|error| fault(image, &error))?;
    let file = ElfFile32::<Endianness>::parse(&*elf).map_err(|error| fault(image, &error))?;
    let endian = file.endian();
    let mut parts = Vec::new();
    for header in file.elf_program_headers() {
        let bytes =
            header.data(endian, &*elf).map_err(|()| fault(image, &"a segment ends outside the file"))?;
        if header.p_type(endian) == PT_LOAD && !bytes.is_empty() {
            parts.push((header.p_paddr(endian), bytes));
        }
    }
    parts.sort_unstable_by_key(|(address, _)| *address);
    let first = parts.first().map_or(0, |(address, _)| *address);
    let mut flat = Vec::new();
    for (address, bytes) in parts {
        // Gaps look like erased flash.
        flat.resize((address - first) as usize, 0xff);
        flat.extend_from_slice(bytes);
    }
    let path = image.with_extension("bin");
    std::fs::write(&path, flat).map_err(|error| fault(&path, &error))?;
    Ok(path)
}

/// Shortens the paths in panic messages, so an image is the same wherever it was built.
fn short_paths() -> String {
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home =
        home.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".cargo"))).unwrap_or_default();
    let registries =
        home.join("registry/src").read_dir().into_iter().flatten().flatten().map(|entry| entry.path());
    let flags = std::iter::once(root().to_owned())
        .chain(registries)
        .map(|path| format!("'--remap-path-prefix={}/='", path.display()));
    format!("target.{TARGET}.rustflags=[{}]", flags.collect::<Vec<_>>().join(","))
}

/// Checks the Linux program for two ARM targets. Needs no prebuilt target; linking would need a cross linker and C libraries.
pub(crate) fn arm() -> Outcome {
    if !has_sources() {
        return Err("Debian's compiler is missing: cargo xtask install arm".into());
    }
    for target in ["aarch64-unknown-linux-gnu", "armv7-unknown-linux-gnueabihf"] {
        let version = output(&mut command(debian().join("rustc"), &["--version"]))?;
        println!("Linux program for {target} with {}", version.trim());
        let mut cargo =
            debian_cargo(&["check", "--locked", "--package", "mobgate-linux", "--bin", "mobgate"]);
        cargo.args(["--target", target, "--target-dir", "target/arm", "-Zbuild-std=std,panic_abort"]);
        cargo.env_remove("RUSTC").env_remove("CARGO").env_remove("RUSTFLAGS");
        tools::run(&mut cargo)?;
    }
    Ok(())
}
