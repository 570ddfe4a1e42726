//! The program under test: started with its own folder and free ports, ended with the test.
// Each test file uses a part of it.
#![allow(dead_code)]

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Instant;

pub(crate) use mobgate_simulator::ports::free_port;
pub(crate) use mobgate_simulator::waiting::{PATIENCE, wait_for};
use rustix::process::{Pid, Signal, kill_process};

pub(crate) mod terminal;

/// The program, not yet started: that of this build, or the one that `MOBGATE_PROGRAM` names.
pub(crate) fn mobgate() -> Command {
    let program = std::env::var_os("MOBGATE_PROGRAM");
    let mut command = Command::new(program.unwrap_or_else(|| env!("CARGO_BIN_EXE_mobgate").into()));
    command.env_remove("RUST_LOG").env_remove("JOURNAL_STREAM").stdin(Stdio::null());
    command
}

/// Runs the program to its end.
pub(crate) fn output(arguments: &[&str]) -> Output {
    mobgate().args(arguments).output().unwrap()
}

/// What the program says on its standard error when it refuses to start with these arguments.
pub(crate) fn refusal(arguments: &[&str]) -> String {
    let refused = output(arguments);
    assert_eq!(refused.status.code(), Some(1), "{arguments:?}: {refused:?}");
    String::from_utf8(refused.stderr).unwrap()
}

/// A listener at a port that the system has chosen, and the port.
pub(crate) fn listening() -> (TcpListener, u16) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = listener.local_addr().unwrap().port();
    (listener, port)
}

/// A running program, with the folder of its configuration file.
pub(crate) struct Program {
    child: Child,
    log: Arc<Mutex<String>>,
    folder: tempfile::TempDir,
    /// The first TCP server's port.
    pub(crate) port: u16,
}

impl Program {
    /// Starts with `settings` in its file, and without a console.
    pub(crate) fn configured(settings: &str) -> Self {
        Self::with(settings, &["--config", "{folder}/mobgate.conf", "--socket", "off"])
    }

    /// Starts the demo on the loopback address, without a console.
    pub(crate) fn demo() -> Self {
        Self::with("", &["--listen", "127.0.0.1:{port}", "--socket", "off"])
    }

    /// The same with a console at its socket.
    pub(crate) fn demo_with_console() -> Self {
        Self::with("", &["--listen", "127.0.0.1:{port}", "--socket", "{folder}/console"])
    }

    /// Starts with `settings` in its file, and `options`. In both `{folder}` becomes that of the file, and `{port}` a free TCP port.
    /// Ready when that is open.
    pub(crate) fn with(settings: &str, options: &[&str]) -> Self {
        Self::by(&mut mobgate(), settings, options)
    }

    /// The same by a command that takes the program's options at its end.
    pub(crate) fn by(command: &mut Command, settings: &str, options: &[&str]) -> Self {
        let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
        let (path, number) = (folder.path().to_str().unwrap(), port.to_string());
        let filled = |text: &str| text.replace("{folder}", path).replace("{port}", &number);
        fs::write(folder.path().join("mobgate.conf"), filled(settings)).unwrap();
        command.args(options.iter().map(|option| filled(option)));
        Self::start(command, folder, port)
    }

    /// Starts `command`, which listens on `port`.
    pub(crate) fn start(command: &mut Command, folder: tempfile::TempDir, port: u16) -> Self {
        Self::try_start(command.stdout(Stdio::piped()).stderr(Stdio::piped()), folder, port).unwrap()
    }

    /// Starts `command` in `folder`, which listens on `port`, or says why that failed. What goes to pipes is the log.
    pub(crate) fn try_start(
        command: &mut Command,
        folder: tempfile::TempDir,
        port: u16,
    ) -> Result<Self, String> {
        let mut child = command.current_dir(folder.path()).spawn().map_err(|error| error.to_string())?;
        let log = Arc::<Mutex<String>>::default();
        child.stderr.take().into_iter().for_each(|stderr| gather(stderr, &log));
        child.stdout.take().into_iter().for_each(|stdout| gather(stdout, &log));
        let mut program = Self { child, log, folder, port };
        let start = Instant::now();
        wait_for("the TCP server", || {
            if TcpStream::connect((Ipv4Addr::LOCALHOST, port)).is_ok() {
                return Some(Ok(()));
            }
            let hopeless = !program.is_running() || start.elapsed() > PATIENCE / 2;
            hopeless.then(|| Err(format!("it does not listen\n{}", program.log())))
        })?;
        Ok(program)
    }

    pub(crate) fn config(&self) -> PathBuf {
        self.file("mobgate.conf")
    }

    /// A file in its folder.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Where the console's socket is, if the program was told to have it in its folder.
    pub(crate) fn socket(&self) -> PathBuf {
        self.file("console")
    }

    /// A session of plain lines at the socket.
    pub(crate) fn session(&self) -> UnixStream {
        let session = UnixStream::connect(self.socket()).unwrap();
        session.set_read_timeout(Some(PATIENCE)).unwrap();
        session
    }

    pub(crate) fn log(&self) -> String {
        self.log.lock().unwrap().clone()
    }

    /// Waits until the log has `text`.
    pub(crate) fn logs(&self, text: &str) {
        wait_for(&format!("{text:?} in the log:\n{}", self.log()), || {
            self.log().contains(text).then_some(())
        });
    }

    pub(crate) fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    pub(crate) fn wait(mut self) -> ExitStatus {
        wait_for("the program's end", || self.child.try_wait().unwrap())
    }

    pub(crate) fn is_running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    /// The time that the program has spent on a processor, in clock ticks of 10 ms.
    pub(crate) fn cpu_ticks(&self) -> u64 {
        let stat = fs::read_to_string(format!("/proc/{}/stat", self.child.id())).unwrap();
        // proc_pid_stat(5): fields 14 and 15, counted behind the name in parentheses, which is field 2.
        let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
        fields[11].parse::<u64>().unwrap() + fields[12].parse::<u64>().unwrap()
    }

    pub(crate) fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, self.port)).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.set_nodelay(true).unwrap();
        stream
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// What the program's descriptors are, as many as there are.
    pub(crate) fn descriptors(&self) -> usize {
        fs::read_dir(format!("/proc/{}/fd", self.child.id())).unwrap().count()
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn gather(from: impl Read + Send + 'static, into: &Arc<Mutex<String>>) {
    let into = into.clone();
    thread::spawn(move || {
        for line in BufReader::new(from).lines().map_while(Result::ok) {
            into.lock().unwrap().push_str(&format!("{line}\n"));
        }
    });
}

/// The settings of the documents' example `name`.
pub(crate) fn example(name: &str) -> String {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/examples").join(name);
    let text = fs::read_to_string(file).unwrap();
    text.split("```").find_map(|block| block.strip_prefix("settings\n")).expect(name).to_owned()
}

/// The program with `settings`, as [`Program::configured`], and a console at its socket.
pub(crate) fn with_console(settings: &str) -> Program {
    Program::with(settings, &["--config", "{folder}/mobgate.conf", "--socket", "{folder}/console"])
}

/// Sends `pdu` to `unit` by Modbus TCP and gives the response's PDU.
pub(crate) fn ask(stream: &mut TcpStream, unit: u8, pdu: &[u8]) -> Vec<u8> {
    let length = (pdu.len() as u16 + 1).to_be_bytes();
    stream.write_all(&[&[0, 1, 0, 0, length[0], length[1], unit], pdu].concat()).unwrap();
    let mut head = [0; 7];
    stream.read_exact(&mut head).unwrap();
    assert_eq!((head[1], head[6]), (1, unit), "transaction and unit come back");
    let mut response = vec![0; usize::from(u16::from_be_bytes([head[4], head[5]])) - 1];
    stream.read_exact(&mut response).unwrap();
    response
}

/// The line of an engineer whose password is `let me in`.
pub(crate) const USER: &str = "user anna role engineer password \
    \"$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA\"\n";

/// Types `line`, and reads until `response` has come.
pub(crate) fn converse(session: &mut (impl Read + Write), line: &str, response: &str) -> String {
    session.write_all(line.as_bytes()).unwrap();
    let mut heard = String::new();
    while !heard.contains(response) {
        let mut piece = [0; 512];
        let count = session.read(&mut piece).unwrap_or_else(|error| panic!("{error} after {heard:?}"));
        assert!(count > 0, "the session ended after {heard:?}");
        heard.push_str(&String::from_utf8_lossy(&piece[..count]));
    }
    heard
}
