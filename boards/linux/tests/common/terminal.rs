//! A terminal for tests, and who runs at it.

use std::fs::File;
use std::process::{Child, Command, Stdio};

use rustix::termios::{
    InputModes, LocalModes, OptionalActions, SpecialCodeIndex, Winsize, tcgetattr, tcsetattr, tcsetwinsize,
};
use serial2::SerialPort;

use super::{PATIENCE, Program, converse, free_port, wait_for};

/// A PTY: a keyboard with a screen, and the terminal's other end.
pub(crate) struct Terminal {
    pub(crate) keyboard: SerialPort,
    pub(crate) end: SerialPort,
    name: String,
}

impl Terminal {
    pub(crate) fn new() -> Self {
        let (mut keyboard, end) = SerialPort::pair().unwrap();
        keyboard.set_read_timeout(PATIENCE).unwrap();
        let mut cooked = tcgetattr(&end).unwrap();
        cooked.local_modes |= LocalModes::ICANON | LocalModes::ECHO | LocalModes::ISIG;
        cooked.input_modes |= InputModes::ICRNL;
        tcsetattr(&end, OptionalActions::Now, &cooked).unwrap();
        let name = rustix::termios::ttyname(&end, Vec::new()).unwrap().into_string().unwrap();
        Self { keyboard, end, name }
    }

    pub(crate) fn open(&self) -> Stdio {
        Stdio::from(File::options().read(true).write(true).open(&self.name).unwrap())
    }

    /// The program with this as its terminal, in a session of its own; setsid(1) of util-linux makes it so.
    pub(crate) fn command(&self) -> Command {
        self.run(env!("CARGO_BIN_EXE_mobgate"))
    }

    /// The same of another program.
    pub(crate) fn run(&self, program: &str) -> Command {
        let mut command = Command::new("setsid");
        command.args(["--ctty", "--wait", program]).stdin(self.open());
        command
    }

    /// Makes it as wide.
    pub(crate) fn resize(&self, columns: u16) {
        let size = Winsize { ws_row: 24, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 };
        tcsetwinsize(&self.end, size).unwrap();
    }

    /// A gateway with the demo's bus.
    pub(crate) fn gateway(&self) -> Program {
        let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
        let mut command = self.command();
        command.args(["--socket", "off", "--listen", &port.to_string()]);
        Program::try_start(command.stdout(self.open()).stderr(Stdio::piped()), folder, port).unwrap()
    }

    /// A gateway with the demo's bus whose log is on the terminal as well.
    pub(crate) fn whole_gateway(&self) -> Program {
        let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
        let mut command = self.command();
        command
            .env_remove("RUST_LOG")
            .env_remove("JOURNAL_STREAM")
            .arg("--socket")
            .arg(folder.path().join("console"));
        command.args(["--listen", &format!("127.0.0.1:{port}")]).stdout(self.open()).stderr(self.open());
        Program::try_start(&mut command, folder, port).unwrap()
    }

    /// A session at the console of `program`.
    pub(crate) fn join(&self, program: &Program) -> Child {
        let mut command = self.command();
        command.arg("console").arg("--socket").arg(program.socket()).stdout(self.open()).stderr(self.open());
        command.spawn().unwrap()
    }

    pub(crate) fn is_cooked(&self) -> bool {
        let modes = tcgetattr(&self.end).unwrap();
        modes.local_modes.contains(LocalModes::ICANON | LocalModes::ECHO)
            && modes.special_codes[SpecialCodeIndex::VINTR] == CTRL_C
    }

    /// Types `keys`, and reads until `response` has come.
    pub(crate) fn type_in(&mut self, keys: &str, response: &str) -> String {
        converse(&mut self.keyboard, keys, response)
    }
}

/// The character that a terminal in its usual mode makes a signal of.
const CTRL_C: u8 = 3;

pub(crate) fn status(mut child: Child) -> std::process::ExitStatus {
    wait_for("the client's end", || child.try_wait().unwrap())
}
