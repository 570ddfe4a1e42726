//! The board's terminal, and the line on which it tells figures.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::thread;

/// The prompt, and that while settings are not saved.
const PROMPTS: [&str; 2] = ["mobgate> ", "mobgate*> "];

/// A session at the terminal.
pub struct Console(UnixStream);

impl Console {
    pub(crate) fn new(line: UnixStream) -> Self {
        Self(line)
    }

    /// Types `keys`.
    pub fn type_keys(&mut self, keys: &str) {
        self.0.write_all(keys.as_bytes()).unwrap();
    }

    /// What is printed up to `end`.
    pub fn read_until(&mut self, end: &str) -> String {
        self.read_until_any(&[end]).0
    }

    /// What is printed up to one of `ends`, and that one's length.
    fn read_until_any(&mut self, ends: &[&str]) -> (String, usize) {
        let mut printed = Vec::new();
        let mut byte = [0];
        loop {
            if let Some(end) = ends.iter().find(|end| printed.ends_with(end.as_bytes())) {
                return (String::from_utf8(printed).unwrap(), end.len());
            }
            let read = self.0.read_exact(&mut byte);
            assert!(read.is_ok(), "no {ends:?} in {:?}", String::from_utf8_lossy(&printed));
            printed.push(byte[0]);
        }
    }

    /// Types `command` and gives what is printed behind it, up to the next prompt.
    pub fn run(&mut self, command: &str) -> String {
        // In front, how wide the terminal is: rows that are looked for stay in one line.
        self.type_keys(&format!("\x1b[8;24;240t{command}\r"));
        self.read_until(&format!("{command}\r\n"));
        let (mut printed, prompt) = self.read_until_any(&PROMPTS);
        printed.truncate(printed.len() - prompt);
        printed.trim_matches(['\r', '\n']).to_owned()
    }

    /// Lets this process's standard input and output be the terminal, until the input ends.
    pub fn join_terminal(self) {
        let mut output = self.0.try_clone().unwrap();
        output.set_read_timeout(None).unwrap();
        thread::spawn(move || io::copy(&mut output, &mut io::stdout()));
        let mut board = self.0;
        for line in io::stdin().lines().map_while(Result::ok) {
            if board.write_all(format!("{line}\r").as_bytes()).is_err() {
                return;
            }
        }
    }

    /// A counter of `show stats`; 0 when it is not printed.
    pub fn count(&mut self, port: &str, event: &str) -> u64 {
        let stats = self.run("show stats");
        let wanted = |line: &&str| line.split_whitespace().take(2).eq([port, event]);
        let line = stats.lines().find(wanted);
        line.and_then(|line| line.split_whitespace().nth(2)?.parse().ok()).unwrap_or(0)
    }
}

/// What the board tells about itself.
pub struct Figures(BufReader<UnixStream>);

impl Figures {
    pub(crate) fn new(line: UnixStream) -> Self {
        Self(BufReader::new(line))
    }

    /// Ticks of 40 ns that the board has been awake, modulo 2^24, and those of them without what moves the bytes of UARTs.
    pub fn busy(&mut self) -> (u32, u32) {
        let told = self.ask(b'b');
        (told[1], told[3])
    }

    /// How long the task of UART 1 waited for the processor since this was last asked, in ticks: in all, how often, at most.
    pub fn waits(&mut self) -> [u32; 3] {
        self.sum(b'w')
    }

    /// How long frames took from UART 2 to 3 and from 3 to 2, from the interrupt of their first bytes until those left: likewise.
    pub fn passed(&mut self) -> [u32; 3] {
        self.sum(b'p')
    }

    fn sum(&mut self, what: u8) -> [u32; 3] {
        let told = self.ask(what);
        [told[1], told[3], told[5]]
    }

    /// The most bytes that the stack has held.
    pub fn stack_bytes(&mut self) -> u32 {
        self.ask(b'm')[1]
    }

    /// Sockets that could be opened.
    pub fn sockets_free(&mut self) -> u32 {
        self.ask(b'm')[3]
    }

    /// The words of a response; those that are no numbers are 0.
    fn ask(&mut self, what: u8) -> Vec<u32> {
        self.0.get_mut().write_all(&[what]).unwrap();
        let mut line = String::new();
        self.0.read_line(&mut line).unwrap();
        line.split_whitespace().map(|word| word.parse().unwrap_or(0)).collect()
    }
}
