//! The emulator, started with its wires in a folder of its own, and ended with its owner.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;

use mobgate_simulator::ports::free_port;

use crate::{Bus, Client, Console, Figures, Image, PATIENCE, image, wait_for};

/// UARTs of the board: the console, three lines, the figures.
const UARTS: usize = 5;
const FIGURES: usize = 4;

/// How the emulator runs.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Each instruction takes the same time, so that the board can count them.
    pub counts_instructions: bool,
    /// What the board is told, see boards/qemu_mps2/emulate.
    pub words: String,
    /// What runs.
    pub image: Image,
}

/// A running emulator.
pub struct Machine {
    child: Child,
    log: Arc<Mutex<String>>,
    folder: PathBuf,
    port: u16,
    ssh_port: u16,
    web_port: u16,
}

impl Machine {
    /// Starts the board in `folder`, where its flash is kept, and waits until its network is up.
    pub fn start(folder: &Path, options: Options) -> Self {
        let machine = Self::start_only(folder, options);
        machine.logs("network up");
        machine
    }

    fn start_only(folder: &Path, options: Options) -> Self {
        let [port, ssh_port, web_port] = [(); 3].map(|()| free_port());
        let mut command = Command::new(image::root().join("boards/qemu_mps2/emulate"));
        command.arg(options.image.build()).arg(folder.join("flash")).env("MOBGATE_WORDS", &options.words);
        for uart in 0..UARTS {
            let path = socket(folder, uart);
            let _ = std::fs::remove_file(&path);
            let id = format!("uart{uart}");
            command.arg("-chardev");
            command.arg(format!("socket,id={id},path={},server=on,wait=off", path.display()));
            command.args(["-serial", &format!("chardev:{id}")]);
        }
        let monitor = folder.join("monitor");
        command.arg("-chardev");
        command.arg(format!("socket,id=monitor,path={},server=on,wait=off", monitor.display()));
        command.args(["-mon", "chardev=monitor"]);
        let forward = |from: u16, to: u16| format!(",hostfwd=tcp:127.0.0.1:{from}-:{to}");
        let forwards = [forward(port, 502), forward(ssh_port, 22), forward(web_port, 80)].concat();
        command.args(["-nic", &format!("user,id=net{forwards}")]);
        if options.counts_instructions {
            // 64 ns for each.
            command.args(["-icount", "shift=6"]);
        }
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().expect("bash");
        let log = Arc::<Mutex<String>>::default();
        let (lines, into) = (BufReader::new(child.stdout.take().unwrap()).lines(), log.clone());
        thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                into.lock().unwrap().push_str(&format!("{line}\n"));
            }
        });
        Self { child, log, folder: folder.to_owned(), port, ssh_port, web_port }
    }

    /// What the board has logged.
    pub fn log(&self) -> String {
        self.log.lock().unwrap().clone()
    }

    /// Waits until the log has `text`.
    pub fn logs(&self, text: &str) {
        self.logs_times(text, 1);
    }

    /// Waits until the log has `text` so many times.
    pub fn logs_times(&self, text: &str, times: usize) {
        wait_for(&format!("{text:?} in the log"), || {
            let log = self.log();
            (log.matches(text).count() >= times).then_some(())
        });
    }

    /// Puts `devices` on the line of UART `uart`.
    pub fn wire(&self, uart: usize, devices: &Bus) {
        devices.serve(self.uart(uart));
    }

    /// The host's end of a UART.
    pub fn uart(&self, uart: usize) -> UnixStream {
        let path = socket(&self.folder, uart);
        let line = wait_for("a UART", || UnixStream::connect(&path).ok());
        line.set_read_timeout(Some(PATIENCE)).unwrap();
        line
    }

    /// A session at the board's terminal.
    pub fn console(&self) -> Console {
        Console::new(self.uart(0))
    }

    /// What the board tells about itself.
    pub fn figures(&self) -> Figures {
        Figures::new(self.uart(FIGURES))
    }

    /// The host's TCP port that leads to the board's Modbus TCP port.
    pub fn port(&self) -> u16 {
        self.port
    }

    /// The host's TCP port that leads to the board's port for SSH.
    pub fn ssh_port(&self) -> u16 {
        self.ssh_port
    }

    /// The host's TCP port that leads to the board's port for the web interface.
    pub fn web_port(&self) -> u16 {
        self.web_port
    }

    /// The emulator's process.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// A Modbus TCP client.
    pub fn client(&self) -> Client {
        Client::connect(self.port)
    }

    /// Lets the emulator's monitor do `command`.
    pub fn monitor(&self, command: &str) {
        self.monitor_line(command, 1);
    }

    /// What stands in the board's register at `address`.
    pub fn register(&self, address: u32) -> u32 {
        let line = self.monitor_line(&format!("xp /1xw {address:#x}"), 2);
        let value =
            line.trim().rsplit_once("0x").and_then(|(_, digits)| u32::from_str_radix(digits, 16).ok());
        value.unwrap_or_else(|| panic!("a register: {line:?}"))
    }

    /// Lets the monitor do `command`; its line `nth`, behind its greeting (0) and the command itself (1).
    fn monitor_line(&self, command: &str, nth: usize) -> String {
        let mut monitor = UnixStream::connect(self.folder.join("monitor")).unwrap();
        writeln!(monitor, "{command}").unwrap();
        // It closes a session whose other end goes, and may not have read it then.
        wait_for("the monitor", || BufReader::new(&monitor).lines().nth(nth)?.ok())
    }

    /// Switches the board off.
    pub fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Runs the image without a file for its flash, which it does not get over.
    pub fn status_without_flash() -> ExitStatus {
        let nowhere = Path::new("/nonexistent/flash");
        let mut command = Command::new(image::root().join("boards/qemu_mps2/emulate"));
        command.arg(image::build()).arg(nowhere).args(["-nic", "user"]);
        command.stdin(Stdio::null()).stdout(Stdio::null()).status().expect("bash")
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        self.kill();
        if thread::panicking() {
            eprintln!("the board's log:\n{}", self.log());
        }
    }
}

fn socket(folder: &Path, uart: usize) -> PathBuf {
    folder.join(format!("uart{uart}"))
}
