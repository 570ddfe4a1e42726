//! Wrong lines of a configuration file, one by one: the message names line, column and word.

use std::fs;

use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::{Connection, Gateway, Ports};
use mobgate::language::WORD_BYTES_MAX;
use mobgate::scanner::ScannerState;
use mobgate::settings::{PORTS_MAX, Settings};
use mobgate_linux::reactor::block_on;
use mobgate_linux::store::FileStore;
use mobgate_linux::{settings, tty};

/// What stands before each of them.
const GOOD: &str = "\
# all of this is good
port P1   serial uart1 rtu client 19200 8E1
port P2   serial uart2 rtu server 9600 8N1

port P3   serial /dev/ttyUSB0 ascii server 9600 7E1
port P502 tcp server 502 clients 16
port P5   tcp server 127.0.0.1:5020
port plc  tcp client 10.0.0.1
port U1   udp server 5030
port P4   serial uart4 ascii client 9600
port scan scanner
route P502 1-64 * * P1
device meter unit 1
point power meter holding 0 count 4
point shown local holding 10 of power
point own   local holding 50
";

/// A line with its wrong word in « », and what the message says.
struct Case<'t> {
    before: &'t str,
    word: &'t str,
    behind: &'t str,
    says: &'t str,
}

fn cases() -> Vec<Case<'static>> {
    let rows = include_str!("wrong_lines.txt").lines().filter(|row| !row.is_empty() && !row.starts_with('#'));
    let case = |row: &'static str| {
        let (line, says) = row.split_once(" => ")?;
        let (before, rest) = line.split_once('«')?;
        let (word, behind) = rest.split_once('»')?;
        Some(Case { before, word, behind, says })
    };
    rows.map(|row| case(row).unwrap_or_else(|| panic!("no case: {row}"))).collect()
}

#[test]
fn three_hundred_wrong_lines_are_named_by_line_column_and_word() {
    let slots = [const { Slot::new() }; 8];
    let ports = Ports::<PORTS_MAX>::new();
    let connections = [const { Connection::new() }; 256];
    let (pool, points) = (FramePool::new(&slots, 0), ScannerState::new());
    let gateway =
        Gateway::new(&pool, &ports, &connections).with_scanner(&points).with_same_device(tty::are_same);
    let file = tempfile::NamedTempFile::new().unwrap();
    let read = |text: &str| {
        fs::write(&file, text).unwrap();
        let mut store = FileStore::untouched(Some(file.path().to_owned()));
        block_on(settings::read(&gateway, &mut store, &mut Settings::new()))
    };
    assert_eq!(read(GOOD), Ok(()));
    let cases = cases();
    assert!(cases.len() >= 300, "{} cases", cases.len());
    let mut wrong = Vec::new();
    for (n, Case { before, word, behind, says }) in cases.iter().enumerate() {
        // Comments and blank lines count.
        let blank = "\n# more\n".repeat(n % 3);
        let line = GOOD.lines().count() + blank.lines().count() + 1;
        let said = read(&format!("{GOOD}{blank}{before}{word}{behind}\n# the end\n"));
        let said = said.err().unwrap_or_else(|| "it was taken".to_owned());
        let column = before.chars().count() + 1;
        let shown = match word.char_indices().take_while(|(at, c)| at + c.len_utf8() <= WORD_BYTES_MAX).last()
        {
            Some((at, last)) => format!("\"{}\"", &word[..at + last.len_utf8()]),
            None => "end of line".to_owned(),
        };
        let begins = format!("{}: line {line}, column {column}: {shown}: ", file.path().display());
        if !said.strip_prefix(&begins).is_some_and(|problem| problem.contains(says)) {
            wrong.push(format!("{before}«{word}»{behind} => {says}\n    {said}"));
        }
    }
    println!("{} wrong lines, {} of them said otherwise", cases.len(), wrong.len());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
