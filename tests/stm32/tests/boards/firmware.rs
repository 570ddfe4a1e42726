//! New firmware by the console: what is taken, what is refused, and the trial.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, Machine, RTU, Reset, Uart};

use crate::figure::{Target, figure};
use crate::lines::{REQUEST, RESPONSE, bytes};
use crate::update_file::{hanging, of_another_board, of_version, signed, with_signature};
use crate::{on_each_board, set_up, started, wait_for_prompt, ymodem};

on_each_board!(
    an_update_by_the_console_runs_on_trial_and_is_confirmed_while_lines_are_served,
    what_is_refused_is_named_and_what_runs_stays,
    an_older_image_is_taken_at_the_terminal_and_goes_back_if_it_hangs,
    an_image_that_finds_no_network_goes_back_and_so_do_its_settings,
    a_fault_and_the_watchdog_end_a_trial,
    power_cuts_while_an_image_is_received_leave_what_runs,
);

/// The longest swap, and a start.
pub(crate) const START_MAX: Duration = Duration::from_secs(60);
/// Longer than a trial that goes well.
const TRIAL: Duration = Duration::from_secs(8);
/// How long the lines may rest for an update, in seconds.
const PAUSE_MAX: f64 = 30.0;
/// Settings of two lines, from one to the other.
const LINES: [&str; 3] = [
    "port P1 serial uart1 rtu client 19200 8E1",
    "port P2 serial uart2 rtu server 19200 8E1",
    "route P2 1-64 * * P1",
];

/// A board with these settings, saved.
fn saved(board: Board, lines: &[&str]) -> Machine {
    let mut machine = started(board);
    set_up(&mut machine, lines);
    save(&mut machine);
    machine
}

fn save(machine: &mut Machine) {
    assert_eq!(machine.type_line("save").unwrap().trim(), "saved");
}

fn shows(machine: &mut Machine, line: &str, text: &str) {
    let shown = machine.type_line(line).unwrap();
    assert!(shown.contains(text), "{line}: {shown:?}, not {text:?}");
}

fn send(machine: &mut Machine, command: &str, file: &[u8]) -> String {
    ymodem::send(machine, command, file, |_| ())
}

/// A master on one line, and the device that it asks on another.
#[derive(Default)]
struct Traffic {
    asked: Vec<u8>,
    answered: Vec<u8>,
    /// When the master has asked and still waits.
    since: Option<Duration>,
    requests: usize,
    served: usize,
    last: Option<Duration>,
    /// The longest time between two responses.
    pause: Duration,
}

impl Traffic {
    fn step(&mut self, machine: &mut Machine) {
        /// The master's time-out.
        const PATIENCE: Duration = Duration::from_secs(1);
        let now = machine.now();
        self.asked.extend(bytes(&machine.sent(Uart::Line1)));
        self.answered.extend(bytes(&machine.sent(Uart::Line2)));
        if self.asked.len() >= REQUEST.len() {
            assert_eq!(self.asked, REQUEST);
            self.asked.clear();
            machine.send(Uart::Line1, &RESPONSE, RTU);
        }
        if self.answered.len() >= RESPONSE.len() {
            assert_eq!(self.answered, RESPONSE);
            self.answered.clear();
            self.since = None;
            self.served += 1;
            self.pause = self.pause.max(self.last.map_or(Duration::ZERO, |last| now - last));
            self.last = Some(now);
        }
        if self.since.is_none_or(|since| now > since + PATIENCE) {
            self.asked.clear();
            self.answered.clear();
            self.requests += 1;
            self.since = Some(now);
            machine.send(Uart::Line2, &REQUEST, RTU);
        }
    }
}

fn an_update_by_the_console_runs_on_trial_and_is_confirmed_while_lines_are_served(board: Board) {
    let mut machine = saved(board, &LINES);
    shows(&mut machine, "show update", "0.1.0: confirmed");
    let new = of_version(&machine.program(), 1, 1);
    let mut traffic = Traffic::default();
    let (from, mut served) = (machine.now(), 0);
    let shown = ymodem::send(&mut machine, "update", &signed(&new), |machine| {
        traffic.step(machine);
        if machine.resets.is_empty() {
            served = traffic.served;
        }
    });
    assert!(shown.contains("0.1.1 is complete and genuine; it starts now, on trial"), "{shown:?}");
    println!(
        "{}: {:?} for the image and its start, {served} requests served until the swap",
        board.name,
        machine.now() - from
    );
    assert!(served > 100, "{served}");
    assert!(machine.program() == new);
    shows(&mut machine, "show update", "0.1.1: on trial");
    shows(&mut machine, "show version", "mobgate 0.1.1 on");
    // At once: nobody is asked for a file.
    shows(&mut machine, "update", "error: the firmware that runs is still on trial");
    let saved_on_trial = "port P3 serial uart3 rtu client 9600 8E1";
    set_up(&mut machine, &[saved_on_trial]);
    save(&mut machine);
    let end = machine.now() + TRIAL;
    while machine.now() < end {
        machine.run(Duration::from_millis(1)).unwrap();
        traffic.step(&mut machine);
    }
    let name = format!("{}_update_pause_s", board.name.trim_start_matches("nucleo_"));
    figure(&name, traffic.pause.as_secs_f64(), "s", Target::AtMost(PAUSE_MAX));
    shows(&mut machine, "show update", "0.1.1: confirmed");
    machine.power_cycle();
    wait_for_prompt(&mut machine);
    assert!(machine.program() == new);
    shows(&mut machine, "show update", "0.1.1: confirmed");
    for line in [LINES[0], LINES[1], saved_on_trial] {
        shows(&mut machine, "show config", line);
    }
}

fn what_is_refused_is_named_and_what_runs_stays(board: Board) {
    let mut machine = started(board);
    let program = machine.program();
    let small = hanging(&program, 1, 1);
    let (mut tampered, whole) = (signed(&small), signed(&small));
    tampered[3000] ^= 1;
    let refused: [(Vec<u8>, &str); 6] = [
        (tampered, "the image's signature is wrong"),
        (with_signature(&small, [0; 64]), "the image's signature is wrong"),
        (signed(&hanging(&program, 0, 9)), "the image is older than what runs"),
        (signed(&of_another_board(&small)), "the image is for another board"),
        (whole[..3500].to_vec(), "the image is incomplete"),
        (small.clone(), "this is no image of mobgate"),
    ];
    for (file, reason) in refused {
        let shown = send(&mut machine, "update", &file);
        assert!(shown.contains(&format!("error: {reason}\r\n")), "{shown:?}, not {reason:?}");
        shows(&mut machine, "show update", "0.1.0: confirmed");
    }
    machine.power_cycle();
    wait_for_prompt(&mut machine);
    assert!(machine.program() == program);
    shows(&mut machine, "show update", "0.1.0: confirmed");
}

fn an_older_image_is_taken_at_the_terminal_and_goes_back_if_it_hangs(board: Board) {
    let mut machine = saved(board, &LINES);
    let program = machine.program();
    let older = signed(&hanging(&program, 0, 9));
    let shown = send(&mut machine, "update older", &older);
    assert!(shown.contains("0.0.9 is complete and genuine; it starts now, on trial"), "{shown:?}");
    assert_eq!(machine.resets, [Reset::Software, Reset::Watchdog]);
    assert!(machine.program() == program);
    let went_back = "0.1.0: went back from 0.0.9: started by the watchdog while on trial";
    shows(&mut machine, "show update", went_back);
    // That is still known, and another one is taken.
    machine.power_cycle();
    wait_for_prompt(&mut machine);
    shows(&mut machine, "show update", went_back);
    shows(&mut machine, "show config", LINES[0]);
    let shown = send(&mut machine, "update older", &older);
    assert!(shown.contains("0.0.9 is complete and genuine"), "{shown:?}");
    assert!(machine.program() == program);
}

/// Swaps in the program as version 0.1.1; before its start `prepare` is done.
fn on_trial(machine: &mut Machine, prepare: impl FnOnce(&mut Machine)) {
    let new = of_version(&machine.program(), 1, 1);
    machine.stage(&new);
    prepare(machine);
    machine.power_cycle();
    machine.wait_for_prompt(START_MAX).unwrap();
    shows(machine, "show update", "0.1.1: on trial");
}

fn an_image_that_finds_no_network_goes_back_and_so_do_its_settings(board: Board) {
    let mut machine = saved(board, &LINES[..1]);
    on_trial(&mut machine, |machine| machine.remove_phy());
    shows(&mut machine, "show config", LINES[0]);
    set_up(&mut machine, &LINES[1..]);
    save(&mut machine);
    machine.run(Duration::from_secs(50)).unwrap();
    shows(&mut machine, "show update", "0.1.1: on trial");
    machine.wait_for_prompt(START_MAX).unwrap();
    assert_eq!(machine.resets, [Reset::Power, Reset::Software]);
    let went_back = "0.1.0: went back from 0.1.1: on trial the network's hardware was not found";
    shows(&mut machine, "show update", went_back);
    shows(&mut machine, "show version", &went_back[7..]);
    shows(&mut machine, "show config", LINES[0]);
    let config = machine.type_line("show config").unwrap();
    assert!(!config.contains(LINES[1]), "{config}");
    machine.power_cycle();
    wait_for_prompt(&mut machine);
    shows(&mut machine, "show update", went_back);
}

fn a_fault_and_the_watchdog_end_a_trial(board: Board) {
    let mut machine = started(board);
    on_trial(&mut machine, |_| ());
    machine.mislead(0x6000_0000);
    machine.wait_for_prompt(START_MAX).unwrap();
    shows(&mut machine, "show update", "0.1.0: went back from 0.1.1: fault 0x00000100 at 0x60000000");
    on_trial(&mut machine, |_| ());
    machine.hang_phy(true);
    while machine.resets.last() != Some(&Reset::Watchdog) {
        machine.run(Duration::from_millis(100)).unwrap();
    }
    machine.hang_phy(false);
    machine.wait_for_prompt(START_MAX).unwrap();
    shows(&mut machine, "show update", "0.1.0: went back from 0.1.1: started by the watchdog while on trial");
}

fn power_cuts_while_an_image_is_received_leave_what_runs(board: Board) {
    let mut machine = started(board);
    let program = machine.program();
    let file = signed(&hanging(&program, 1, 1));
    let words = 4096 / machine.flash_word_bytes();
    // The erasure of the page, its first and last word; that the progress is void, and the erasure of the state.
    for operation in [0, 1, words, words + 1, words + 2] {
        machine.cut_power_at(operation);
        let cut = ymodem::try_send(&mut machine, "update", &file, |_| ());
        assert!(cut.is_err(), "operation {operation}: {cut:?}");
        machine.keep_power();
        machine.power_cycle();
        wait_for_prompt(&mut machine);
        assert!(machine.program() == program, "operation {operation}");
        shows(&mut machine, "show update", "0.1.0: confirmed");
    }
    let shown = send(&mut machine, "update", &file);
    assert!(shown.contains("0.1.1 is complete and genuine"), "{shown:?}");
}
