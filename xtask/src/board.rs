//! cargo for what runs on another processor, and the one place that knows where a toolchain for it is: rustup's, when
//! `rustup target add` could fetch the target; else Debian's compiler, which brings the sources of the standard library,
//! so that the library is built along.

use std::path::{Path, PathBuf};
use std::process::Command;

use object::Endianness;
use object::elf::PT_LOAD;
use object::read::elf::{ElfFile32, ProgramHeader};

use crate::tools::{self, Outcome, command, output, root};

/// A Cortex-M4 or -M7 with a floating-point unit.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// The folder of an image: `target/thumb/...`.
pub(crate) fn images() -> PathBuf {
    root().join("target/thumb").join(TARGET).join("release")
}

/// The program that a board's package builds.
pub(crate) fn image(board: &str) -> PathBuf {
    images().join(format!("mobgate-{}", board.replace('_', "-")))
}

/// The boards with an STM32, which are alike: the folders `boards/nucleo_...`.
pub(crate) fn nucleos() -> Outcome<Vec<String>> {
    let folder = root().join("boards").read_dir().map_err(|error| format!("boards/: {error}"))?;
    let names = folder.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    let mut nucleos: Vec<String> = names.filter(|name| name.starts_with("nucleo_")).collect();
    nucleos.sort();
    Ok(nucleos)
}

/// Where the compiler with the standard library's sources is.
fn debian() -> PathBuf {
    std::env::var_os("DEBIAN_RUST").map_or("/usr/bin".into(), PathBuf::from)
}

/// Whether this compiler has the library of the target built.
fn has_core() -> bool {
    let library = sysroot(Path::new("rustc")).map(|root| root.join("lib/rustlib").join(TARGET).join("lib"));
    let files = library.and_then(|folder| folder.read_dir().ok());
    files.is_some_and(|mut files| {
        files.any(|file| file.is_ok_and(|file| file.file_name().to_string_lossy().starts_with("libcore-")))
    })
}

/// Whether Debian's compiler is here, with the sources of the standard library.
pub(crate) fn has_sources() -> bool {
    let sources = sysroot(&debian().join("rustc"))
        .map(|root| root.join("lib/rustlib/src/rust/library/core/Cargo.toml"));
    debian().join("cargo").exists() && sources.is_some_and(|file| file.exists())
}

/// Whether something here builds for a Cortex-M, and lints it.
pub(crate) fn has_toolchain() -> bool {
    has_core()
        || has_sources() && debian().join("clippy-driver").exists() && tools::program("ld.lld").is_some()
}

fn sysroot(rustc: &Path) -> Option<PathBuf> {
    let printed = Command::new(rustc).args(["--print", "sysroot"]).output().ok()?;
    Some(String::from_utf8(printed.stdout).ok()?.trim().into())
}

/// Debian's cargo, with options that are unstable on any other.
fn debian_cargo(arguments: &[&str]) -> Command {
    let mut cargo = command(debian().join("cargo"), arguments);
    let path = std::env::var_os("PATH").unwrap_or_default();
    let path = std::iter::once(debian()).chain(std::env::split_paths(&path));
    cargo.env("PATH", std::env::join_paths(path).unwrap_or_default()).env("RUSTC_BOOTSTRAP", "1");
    cargo.env_remove("RUSTUP_TOOLCHAIN");
    cargo
}

/// Runs a command of cargo for a board, or for `core`, the gateway's core without one.
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
        // rustup's compiler has a linker of its own, Debian's has not.
        cargo.env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", "ld.lld");
        (cargo, debian().join("rustc"))
    } else {
        return Err(format!(
            "no core library for {TARGET}: run 'rustup target add {TARGET}', or on Debian 'cargo xtask install thumb'"
        ));
    };
    // Settings of a host build that do not hold here: cargo of rustup hands its own compiler on.
    cargo.env_remove("RUSTC").env_remove("CARGO").env_remove("RUSTFLAGS");
    if core {
        cargo.args(["--package", "mobgate", "--lib", "--no-default-features"]);
    } else {
        // Each board's own .cargo/config.toml and regions.x are found from its folder.
        cargo.current_dir(&folder);
    }
    // A target folder of its own: another compiler's files would be rebuilt at every change between the two.
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

/// Writes beside an image what its flash holds, byte by byte from its first address on, for tools that take no ELF file.
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
        // What lies between two parts is as erased flash is.
        flat.resize((address - first) as usize, 0xff);
        flat.extend_from_slice(bytes);
    }
    let path = image.with_extension("bin");
    std::fs::write(&path, flat).map_err(|error| fault(&path, &error))?;
    Ok(path)
}

/// The paths that panics name are short ones, and an image is the same wherever it was built.
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

/// Checks the Linux program for two ARM targets. No target has to be fetched; linking would need a cross linker and the C
/// library of each.
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
