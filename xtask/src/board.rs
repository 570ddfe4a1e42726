//! Runs cargo for other processors. Only this file knows where their toolchain is: rustup's, if the target has been added; else
//! Debian's compiler, which ships the sources of the standard library, so that it is built along.

use std::path::{Path, PathBuf};
use std::process::Command;

use object::Endianness;
use object::elf::PT_LOAD;
use object::read::elf::{ElfFile32, ProgramHeader};

use crate::key::Key;
use crate::tools::{self, Outcome, command, fault, output, root, written};
use crate::update;

/// A Cortex-M4 or Cortex-M7 with FPU: the core's, and that of most boards.
const TARGET: &str = "thumbv7em-none-eabihf";
/// Boards with an RP2040, which start from UF2 files.
pub(crate) const RP2040: [&str; 1] = ["w5500_evb_pico"];

/// The target that a board names in its `.cargo/config.toml`.
pub(crate) fn target(board: &str) -> Outcome<String> {
    if board == "core" {
        return Ok(TARGET.into());
    }
    let config = tools::read(format!("boards/{board}/.cargo/config.toml"))?;
    let named = config.lines().find_map(|line| line.strip_prefix("target = \"")?.strip_suffix('"'));
    named.map(str::to_owned).ok_or(format!("boards/{board}/.cargo/config.toml names no target"))
}

/// Folder of the images for a target: `target/thumb/...`.
fn images(target: &str) -> PathBuf {
    root().join("target/thumb").join(target).join("release")
}

/// The image of a board.
pub(crate) fn image(board: &str) -> Outcome<PathBuf> {
    Ok(images(&target(board)?).join(format!("mobgate-{}", board.replace('_', "-"))))
}

/// The boot loader of a board.
pub(crate) fn boot_loader(board: &str) -> Outcome<PathBuf> {
    let mut name = image(board)?.into_os_string();
    name.push("-boot");
    Ok(name.into())
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
fn has_core(target: &str) -> bool {
    let library = sysroot(Path::new("rustc")).map(|root| root.join("lib/rustlib").join(target).join("lib"));
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
    has_core(TARGET)
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
    let target = target(board)?;
    // cargo would lint the board's package alone, and none of those that boards share: xtask/rustc lints all.
    let lints = subcommand == "clippy";
    let (mut cargo, rustc) = compiler(&target, if lints { "check" } else { subcommand }, core)?;
    if lints {
        let clippy = rustc.with_file_name("clippy-driver");
        cargo
            .env("MOBGATE_CLIPPY", clippy)
            .env("CLIPPY_ARGS", "-D__CLIPPY_HACKERY__warnings__CLIPPY_HACKERY__");
    }
    // The same image wherever it is built.
    cargo.env("RUSTC_WRAPPER", root().join("xtask/rustc"));
    cargo.env("MOBGATE_PUBLIC_KEY", Key::for_images()?.public());
    if core {
        cargo.args(["--package", "mobgate", "--lib", "--no-default-features"]);
    } else {
        // cargo finds .cargo/config.toml and the linker regions.x from the board's folder.
        cargo.current_dir(&folder);
    }
    // A separate target folder: sharing one would rebuild everything when switching compilers.
    cargo
        .args(["--locked", "--release", "--target", &target, "--target-dir"])
        .arg(root().join("target/thumb"));
    cargo.arg("--config").arg(short_paths(&target, &rustc)).args(arguments);
    // Sizes depend on the compiler.
    eprintln!("{board} for {target} with {}", output(&mut command(&rustc, &["--version"]))?.trim());
    if subcommand == "run" && has_boot_loader(board) {
        run(board, "build", arguments)?;
        flash_boot_loader(board)?;
    }
    tools::run(&mut cargo)?;
    match subcommand {
        "build" if core => tools::built(images(&target).join("libmobgate.rlib")),
        "build" => write_files(board),
        _ => Ok(()),
    }
}

/// cargo with the compiler that builds for a target, and that compiler.
fn compiler(target: &str, subcommand: &str, core: bool) -> Outcome<(Command, PathBuf)> {
    let (mut cargo, rustc) = if has_core(target) {
        (command("cargo", &[subcommand]), PathBuf::from("rustc"))
    } else if has_sources() {
        let mut cargo = debian_cargo(&[subcommand]);
        // Boards link crates that name `alloc` without using it; the core must do without.
        cargo.arg(if core { "-Zbuild-std=core" } else { "-Zbuild-std=core,alloc" });
        // As rustup's: copies of memory are a tenth of a transaction's instructions.
        cargo.args(["--config", "profile.release.package.compiler_builtins.opt-level=3"]);
        // rustup's compiler ships a linker, Debian's does not.
        let linker = target.replace('-', "_").to_uppercase();
        cargo.env(format!("CARGO_TARGET_{linker}_LINKER"), "ld.lld");
        (cargo, debian().join("rustc"))
    } else {
        return Err(format!(
            "no core library for {target}: run 'rustup target add {target}', or on Debian 'cargo xtask install thumb'"
        ));
    };
    // Settings of the host build do not apply; rustup's cargo passes its own compiler on.
    cargo.env_remove("RUSTC").env_remove("CARGO").env_remove("RUSTFLAGS");
    Ok((cargo, rustc))
}

/// Writes what goes into a board's flash beside the image that was built, and says where.
fn write_files(board: &str) -> Outcome {
    let image = image(board)?;
    tools::built(&image)?;
    let boot = if has_boot_loader(board) { Some(boot_loader(board)?) } else { None };
    // The boot loader is the beginning.
    let all: Vec<&Path> = boot.as_deref().into_iter().chain([image.as_path()]).collect();
    let is_rp2040 = RP2040.contains(&board);
    tools::built(if is_rp2040 { write_uf2(&image, &all)? } else { write_flat(&image, &all)? })?;
    update::write(&image)?.map_or(Ok(()), tools::built)
}

/// An image without EtherCAT, and with users and the audit trail.
pub(crate) const WITH_USERS: [&str; 2] = ["--no-default-features", "--features=users"];
/// One with the web interface too, which is for users.
pub(crate) const WITH_WEB: [&str; 2] = ["--no-default-features", "--features=web"];

/// Whether a board's package has a feature.
pub(crate) fn has_feature(board: &str, feature: &str) -> Outcome<bool> {
    Ok(tools::read(format!("boards/{board}/Cargo.toml"))?.contains(&format!("\n{feature} = [")))
}

/// Builds the images of a board: first those without EtherCAT, which are kept beside the other. Users are tested in the image with the
/// web interface, where there is one.
pub(crate) fn build_all(board: &str) -> Outcome {
    let users = if has_feature(board, "web")? { &WITH_WEB } else { &WITH_USERS };
    for (arguments, behind) in [(&users[..], "-with-users"), (&WITH_USERS[..1], "-without-ethercat")] {
        run(board, "build", &arguments.iter().map(|&word| word.into()).collect::<Vec<_>>())?;
        let image = image(board)?;
        let mut kept = image.clone().into_os_string();
        kept.push(behind);
        std::fs::copy(&image, &kept).map_err(|error| fault(&image, &error))?;
    }
    run(board, "build", &[])
}

/// Whether a board's package has a boot loader beside the program.
fn has_boot_loader(board: &str) -> bool {
    board.starts_with("nucleo_") || RP2040.contains(&board)
}

/// Writes the boot loader into a board's flash by probe-rs, which the board's `.cargo/config.toml` names for the program.
fn flash_boot_loader(board: &str) -> Outcome {
    let config = tools::read(format!("boards/{board}/.cargo/config.toml"))?;
    let runner =
        config.lines().find_map(|line| line.strip_prefix("runner = \"probe-rs run ")?.strip_suffix('"'));
    let runner = runner.ok_or(format!("boards/{board}/.cargo/config.toml has no runner"))?;
    let mut probe = command("probe-rs", &["download"]);
    tools::run(probe.args(runner.split_whitespace()).arg(boot_loader(board)?))
}

/// Writes the flash contents of `all` beside an image as a flat binary, for tools that do not read ELF.
fn write_flat(image: &Path, all: &[&Path]) -> Outcome<PathBuf> {
    let (_, flat) = flat(all)?;
    written(image.with_extension("bin"), &flat)
}

/// Writes the flash contents of `all` beside an image as a UF2 file (github.com/microsoft/uf2): blocks of 512 bytes with a page of 256
/// each.
fn write_uf2(image: &Path, all: &[&Path]) -> Outcome<PathBuf> {
    const HAS_FAMILY: u32 = 0x2000;
    const FAMILY: u32 = 0xe48b_ff56;
    const PAGE_BYTES: u32 = 256;
    let (first, flat) = flat(all)?;
    let pages = flat.chunks(PAGE_BYTES as usize);
    let count = pages.len() as u32;
    let mut file = Vec::new();
    for (number, page) in (0..).zip(pages) {
        let address = first + number * PAGE_BYTES;
        let head = [0x0a32_4655, 0x9e5d_5157, HAS_FAMILY, address, PAGE_BYTES, number, count, FAMILY];
        let begin = file.len();
        file.extend(head.iter().flat_map(|word: &u32| word.to_le_bytes()));
        file.extend_from_slice(page);
        file.resize(begin + 508, 0);
        file.extend(0x0ab1_6f30_u32.to_le_bytes());
    }
    written(image.with_extension("uf2"), &file)
}

/// The flash contents of images, and where they begin.
pub(crate) fn flat(images: &[&Path]) -> Outcome<(u32, Vec<u8>)> {
    let mut parts = Vec::new();
    for image in images {
        let elf = std::fs::read(image).map_err(|error| fault(image, &error))?;
        let file = ElfFile32::<Endianness>::parse(&*elf).map_err(|error| fault(image, &error))?;
        let endian = file.endian();
        for header in file.elf_program_headers() {
            let bytes =
                header.data(endian, &*elf).map_err(|()| fault(image, &"a segment ends outside the file"))?;
            if header.p_type(endian) == PT_LOAD && !bytes.is_empty() {
                parts.push((header.p_paddr(endian), bytes.to_vec()));
            }
        }
    }
    parts.sort_unstable_by_key(|(address, _)| *address);
    let first = parts.first().map_or(0, |(address, _)| *address);
    let mut flat = Vec::new();
    for (address, bytes) in parts {
        // Gaps look like erased flash.
        flat.resize((address - first) as usize, 0xff);
        flat.extend(bytes);
    }
    Ok((first, flat))
}

/// Shortens the paths in panic messages and in what a debugger reads, so an image is the same wherever it was built.
fn short_paths(target: &str, rustc: &Path) -> String {
    let flags = remapped(rustc).map(|path| format!("'--remap-path-prefix={}/='", path.display()));
    format!("target.{target}.rustflags=[{}]", flags.collect::<Vec<_>>().join(","))
}

/// Folders of sources: the checkout, the crates, and the standard library where it is built along.
pub(crate) fn remapped(rustc: &Path) -> impl Iterator<Item = PathBuf> {
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home =
        home.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".cargo"))).unwrap_or_default();
    let registries =
        home.join("registry/src").read_dir().into_iter().flatten().flatten().map(|entry| entry.path());
    let library = sysroot(rustc).map(|root| root.join("lib/rustlib/src/rust"));
    std::iter::once(root().to_owned()).chain(registries).chain(library)
}

/// Checks the Linux program for these ARM targets. Needs no prebuilt target; linking would need a cross linker and C libraries.
pub(crate) fn arm(targets: &[String]) -> Outcome {
    if !has_sources() {
        return Err("Debian's compiler is missing: cargo xtask install arm".into());
    }
    for target in targets {
        let version = output(&mut command(debian().join("rustc"), &["--version"]))?;
        println!("Linux program for {target} with {}", version.trim());
        let mut cargo =
            debian_cargo(&["check", "--locked", "--package", "mobgate-linux", "--bin", "mobgate"]);
        cargo.args(["--target", &**target, "--target-dir", "target/arm", "-Zbuild-std=std,panic_abort"]);
        cargo.env_remove("RUSTC").env_remove("CARGO").env_remove("RUSTFLAGS");
        tools::run(&mut cargo)?;
    }
    Ok(())
}
