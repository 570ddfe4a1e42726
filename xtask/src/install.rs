//! Dependencies of the commands besides Rust: how to detect and install them, by apt-get, pip, npm or cargo.

use std::path::Path;

use clap::ValueEnum;

use crate::board;
use crate::tools::{self, Outcome, command, program, read, root, run, succeeds};

/// What the dependencies are for.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub(crate) enum Group {
    /// The workspace's tests: third-party Modbus and EtherCAT programs
    Peers,
    /// A compiler for a Cortex-M
    Thumb,
    /// The emulated board
    Qemu,
    /// The emulator of the STM32 boards
    Stm32,
    /// The emulator of the RP2040
    Rp2040,
    /// A compiler for ARM Linux
    Arm,
    /// The Debian package and its test
    Package,
    /// The web interface's page in a browser
    Browser,
    /// Instructions and system calls
    Counts,
    /// The fuzzer
    Fuzz,
    /// The documents as a book
    Book,
    /// Licences, sources and advisories of crates
    Deny,
    /// The SBOM of a release
    Release,
}

/// How to install it.
enum By {
    Apt(&'static [&'static str]),
    /// A crate, built from source.
    Cargo(&'static str),
    /// A function: lock files into target/, QEMU from backports.
    Own(fn() -> Outcome),
}

struct Need {
    group: Group,
    name: &'static str,
    by: By,
    found: fn(&str) -> bool,
}

const DEBIAN_RUST: By = By::Apt(&["rustc-web", "cargo-web", "rust-web-src", "rust-web-clippy", "lld"]);

const NEEDS: [Need; 41] = [
    by_apt(Group::Peers, "mbpoll", &["mbpoll"]),
    by_apt(Group::Package, "mbpoll", &["mbpoll"]),
    by_apt(Group::Peers, "mosquitto_sub", &["mosquitto", "mosquitto-clients"]),
    by_apt(Group::Peers, "ssh", &["openssh-client"]),
    by_apt(Group::Peers, "openssl", &["openssl"]),
    by_apt(Group::Peers, "socat", &["socat"]),
    by_apt(Group::Peers, "tshark", &["tshark"]),
    by_apt(Group::Peers, "ip", &["iproute2"]),
    // soemx is built from source, with libpcap.
    by_apt(Group::Peers, "gcc", &["gcc", "libc6-dev"]),
    need(Group::Peers, "pcap.h", By::Apt(&["libpcap-dev"]), |_| {
        Path::new("/usr/include/pcap/pcap.h").exists()
    }),
    need(Group::Peers, "python3 with venv", By::Apt(&["python3-venv"]), |_| {
        succeeds(&mut command("python3", &["-c", "import ensurepip, venv"]))
    }),
    by_apt(Group::Peers, "npm", &["npm"]),
    need(
        Group::Peers,
        "pymodbus, pysunspec2, zeroconf, pysoem, soemx, KickCAT, ethercat-mcp, paho-mqtt, protobuf in target/python",
        By::Own(python),
        |_| is_installed(REQUIREMENTS, "target/python"),
    ),
    need(Group::Peers, "modbus-serial in target/node", By::Own(node), |_| {
        is_installed(PACKAGES, "target/node")
    }),
    need(Group::Peers, "promtool", By::Own(promtool), |name| {
        program(name).is_some() || root().join(PROMTOOL).exists()
    }),
    need(Group::Thumb, "a compiler for a Cortex-M", DEBIAN_RUST, |_| board::has_toolchain()),
    // Debian 12 has 7.2, which is too old for the tests.
    need(Group::Qemu, "qemu-system-arm of version 8 or later", By::Own(qemu), |_| {
        qemu_version().is_some_and(|version| version >= 8)
    }),
    by_apt(Group::Stm32, "cmake", &["cmake"]),
    by_apt(Group::Stm32, "cc", &["gcc", "libc6-dev", "make"]),
    need(Group::Stm32, "libclang", By::Apt(&["libclang-dev"]), |_| has_libclang()),
    by_apt(Group::Stm32, "sb", &["lrzsz"]),
    by_apt(Group::Rp2040, "npm", &["npm"]),
    by_apt(Group::Rp2040, "python3", &["python3"]),
    by_apt(Group::Rp2040, "ip", &["iproute2"]),
    need(Group::Rp2040, "rp2040js and modbus-serial in tests/rp2040", By::Own(rp2040), |_| {
        is_installed(RP2040_PACKAGES, RP2040_FOLDER)
    }),
    need(Group::Arm, "Debian's Rust with sources", DEBIAN_RUST, |_| board::has_sources()),
    // The cryptography of SSH and TLS is partly C.
    by_apt(Group::Arm, "aarch64-linux-gnu-gcc", &["gcc-aarch64-linux-gnu", "libc6-dev-arm64-cross"]),
    by_apt(Group::Arm, "arm-linux-gnueabihf-gcc", &["gcc-arm-linux-gnueabihf", "libc6-dev-armhf-cross"]),
    by_apt(Group::Package, "mmdebstrap", &["mmdebstrap"]),
    by_cargo(Group::Package, "cargo-deb"),
    by_apt(Group::Browser, "chromium", &["chromium"]),
    by_apt(Group::Browser, "npm", &["npm"]),
    by_apt(Group::Browser, "mbpoll", &["mbpoll"]),
    need(Group::Browser, "playwright-core and axe-core in target/browser", By::Own(browser), |_| {
        is_installed(BROWSER_PACKAGES, "target/browser")
    }),
    by_apt(Group::Counts, "valgrind", &["valgrind"]),
    by_apt(Group::Counts, "strace", &["strace"]),
    by_apt(Group::Fuzz, "c++", &["g++"]),
    by_cargo(Group::Fuzz, "cargo-fuzz"),
    by_cargo(Group::Book, "mdbook"),
    by_cargo(Group::Deny, "cargo-deny"),
    by_cargo(Group::Release, "cargo-cyclonedx"),
];

const fn need(group: Group, name: &'static str, by: By, found: fn(&str) -> bool) -> Need {
    Need { group, name, by, found }
}

const fn by_apt(group: Group, name: &'static str, packages: &'static [&'static str]) -> Need {
    need(group, name, By::Apt(packages), |name| program(name).is_some())
}

const fn by_cargo(group: Group, name: &'static str) -> Need {
    need(group, name, By::Cargo(name), |name| program(name).is_some())
}

/// Missing dependencies of these groups; of all groups if none are given.
fn missing(groups: &[Group]) -> Vec<&'static Need> {
    let needs = NEEDS.iter().filter(|need| groups.is_empty() || groups.contains(&need.group));
    let mut missing: Vec<_> = needs.filter(|need| !(need.found)(need.name)).collect();
    // Groups may share a dependency.
    missing.dedup_by_key(|need| need.name);
    missing
}

/// Fails with a list of what is missing for these groups; for all if none are given.
pub(crate) fn check(groups: &[Group]) -> Outcome {
    all(groups, false)
}

/// Installs and lists what these groups need (all groups if none are given), or with `install` off only fails with the list.
pub(crate) fn all(groups: &[Group], install: bool) -> Outcome {
    let missing = missing(groups);
    if missing.is_empty() {
        return Ok(());
    }
    let mut packages: Vec<&str> = Vec::new();
    for need in &missing {
        if let By::Apt(of) = need.by {
            packages.extend(of.iter().filter(|package| !packages.contains(package)).collect::<Vec<_>>());
        }
    }
    if !install {
        let names: Vec<&str> = missing.iter().map(|need| need.name).collect();
        let groups = groups.iter().filter_map(ValueEnum::to_possible_value);
        let mut how =
            groups.fold("cargo xtask install".to_owned(), |how, group| how + " " + group.get_name());
        if !packages.is_empty() {
            how = format!("apt-get install {}, then {how}", packages.join(" "));
        }
        return Err(format!("missing: {}\n  {how}", names.join(", ")));
    }
    if !packages.is_empty() {
        apt(&packages)?;
    }
    for need in &missing {
        match need.by {
            By::Apt(_) => {}
            By::Cargo(name) => {
                println!("installing by cargo: {name}");
                // Not optimized: that would take longer than what these have to do.
                let mut cargo = command("cargo", &["install", "--quiet", "--locked", "--debug", name]);
                run(cargo.env("CARGO_PROFILE_DEV_DEBUG", "0"))?;
            }
            By::Own(install) => {
                println!("installing: {}", need.name);
                install()?;
            }
        }
    }
    Ok(())
}

/// A command run as root, by sudo if necessary.
fn as_root(arguments: &[&str]) -> std::process::Command {
    let root = tools::output(&mut command("id", &["-u"])).is_ok_and(|id| id.trim() == "0");
    let mut command = if root { command("env", &[""; 0]) } else { command("sudo", &["env"]) };
    command.arg("DEBIAN_FRONTEND=noninteractive").args(arguments);
    command
}

fn apt(packages: &[&str]) -> Outcome {
    if program("apt-get").is_none() {
        return Err(format!("no apt-get here; on Debian these packages are needed: {}", packages.join(" ")));
    }
    println!("installing by apt-get: {}", packages.join(" "));
    run(&mut as_root(&["apt-get", "update", "-qq"]))?;
    run(as_root(&["apt-get", "install", "-y", "-qq"]).args(packages).stdout(std::process::Stdio::null()))
}

fn qemu_version() -> Option<u32> {
    let printed = command("qemu-system-arm", &["--version"]).output().ok()?;
    let text = String::from_utf8(printed.stdout).ok()?;
    text.split_once("version ")?.1.split('.').next()?.parse().ok()
}

/// Whether Debian's libclang is here, which describes headers of C to Rust.
fn has_libclang() -> bool {
    let versions = Path::new("/usr/lib").read_dir().into_iter().flatten().flatten();
    let mut versions = versions.filter(|entry| entry.file_name().to_string_lossy().starts_with("llvm-"));
    versions.any(|entry| entry.path().join("lib/libclang.so").exists())
}

/// Debian 12 has the newer version in its backports, on the machine's usual mirror.
fn qemu() -> Outcome {
    let release = std::fs::read_to_string("/etc/os-release").unwrap_or_default();
    if !release.contains("VERSION_CODENAME=bookworm") {
        return apt(&["qemu-system-arm"]);
    }
    let lists =
        std::fs::read_dir("/etc/apt/sources.list.d").into_iter().flatten().flatten().map(|file| file.path());
    let lists = lists.chain(["/etc/apt/sources.list".into()]);
    let text: String = lists.filter_map(|list| std::fs::read_to_string(list).ok()).collect();
    let words = text.lines().filter_map(|line| {
        let mut words = line.split_whitespace();
        matches!(words.next()?, "URIs:" | "deb").then(|| words.find(|word| word.contains("://"))).flatten()
    });
    let mut archives = words.filter(|word| word.trim_end_matches('/').ends_with("debian"));
    let archive = archives.next().ok_or("apt's lists name no archive of Debian")?;
    let line = format!(
        "echo 'deb {archive} bookworm-backports main' >/etc/apt/sources.list.d/bookworm-backports.list"
    );
    run(&mut as_root(&["sh", "-c", &line]))?;
    apt(&["qemu-system-arm", "qemu-system-common", "qemu-system-data"]
        .map(|name| format!("{name}/bookworm-backports"))
        .each_ref()
        .map(String::as_str))
}

const REQUIREMENTS: &str = "boards/linux/tests/peers/requirements.txt";
const PACKAGES: &str = "boards/linux/tests/peers/node/package-lock.json";
/// In the unpacked package.
const PROMTOOL: &str = "target/promtool/usr/bin/promtool";
const BROWSER_PACKAGES: &str = "boards/linux/tests/browser/package-lock.json";

/// Beside the tests, where node looks for packages that modules import.
const RP2040_FOLDER: &str = "tests/rp2040/node_modules";
const RP2040_PACKAGES: &str = "tests/rp2040/package-lock.json";

/// Whether the folder has the contents of this lock file.
fn is_installed(list: &str, folder: &str) -> bool {
    read(list).is_ok_and(|list| read(format!("{folder}/installed")).is_ok_and(|installed| installed == list))
}

/// Marks the contents of the lock file as installed.
fn note_installed(list: &str, folder: &str) -> Outcome {
    let file = root().join(folder).join("installed");
    std::fs::write(&file, read(list)?).map_err(|error| format!("{}: {error}", file.display()))
}

fn python() -> Outcome {
    run(&mut command("python3", &["-m", "venv", "target/python"]))?;
    let pip =
        ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "-r", REQUIREMENTS];
    run(&mut command("target/python/bin/python3", &pip))?;
    note_installed(REQUIREMENTS, "target/python")
}

/// Unpacked only: the package would run a Prometheus on this machine.
fn promtool() -> Outcome {
    let folder = root().join("target/promtool");
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    run(command("apt-get", &["download", "--quiet", "prometheus"]).current_dir(&folder))?;
    let unpack = "dpkg-deb --extract prometheus_*.deb . && rm prometheus_*.deb";
    run(command("sh", &["-c", unpack]).current_dir(&folder))
}

fn node() -> Outcome {
    npm_into(PACKAGES, "target/node")
}

/// The browser itself is Debian's.
fn browser() -> Outcome {
    npm_into(BROWSER_PACKAGES, "target/browser")
}

/// Installs the packages of a lock file, and of the package.json beside it, into a folder.
fn npm_into(list: &str, target: &str) -> Outcome {
    let folder = root().join(target);
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    for file in [list, &list.replace("package-lock", "package")] {
        let from = root().join(file);
        let to = folder.join(from.file_name().unwrap_or_default());
        std::fs::copy(&from, to).map_err(|error| format!("{file}: {error}"))?;
    }
    npm(target)?;
    note_installed(list, target)
}

fn rp2040() -> Outcome {
    npm("tests/rp2040")?;
    note_installed(RP2040_PACKAGES, RP2040_FOLDER)
}

/// Installs the packages of the folder's lock file without their install scripts: serialport ships prebuilt binaries.
fn npm(folder: &str) -> Outcome {
    let arguments =
        ["ci", "--prefix", folder, "--ignore-scripts", "--no-audit", "--no-fund", "--loglevel", "error"];
    run(command("npm", &arguments).stdout(std::process::Stdio::null()))
}
