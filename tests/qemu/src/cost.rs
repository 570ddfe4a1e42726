//! What the gateway costs on the board: instructions, by SysTick where each takes the same time, and bytes of memory.

use std::io::{Read, Write};
use std::path::Path;
use std::process::Command;
use std::thread::sleep;
use std::time::Duration;

use mobgate_simulator::device::rtu;

use crate::figure::{Target, figure};
use crate::{Bus, Console, Figures, Machine, Options, image};

/// The counts and sizes that hold as good; more is a fault that a change of this file must own up to.
const BUDGETS: &str = include_str!("../budgets");
/// Room that a count has above its budget.
const GROWTH: f64 = 1.05;
/// Times that each thing is measured.
const TRIALS: usize = 21;
/// Time after which nothing happens any more.
const SETTLED: Duration = Duration::from_millis(60);
/// A tick is 40 ns, an instruction 64 ns.
const INSTRUCTIONS_PER_TICK: f64 = 40.0 / 64.0;
/// Most instructions for a byte that is passed on.
const PER_BYTE_MAX: f64 = 60.0;
/// Bytes that a master's UART has at a time: what the board's driver waits for.
const PIECE_BYTES: usize = 64;
/// Time that those take on a line of 19200 baud, where a frame takes longer than the jitter of reads that is allowed for.
const PIECE_TIME: Duration = Duration::from_micros(36_667);

/// Prints the sizes of the image.
pub fn sizes() {
    let output = Command::new("size").arg(image::build()).output().expect("size, of binutils");
    let text = String::from_utf8(output.stdout).unwrap();
    let numbers: Vec<f64> = text
        .lines()
        .nth(1)
        .unwrap_or_default()
        .split_whitespace()
        .map_while(|word| word.parse().ok())
        .collect();
    let [code, data, bss] = numbers[..3] else { panic!("{text}") };
    figure("qemu_image_flash", code + data, "bytes", Target::AtMost(budget("image_flash")));
    figure("qemu_image_ram", data + bss, "bytes", Target::AtMost(budget("image_ram")));
}

/// Prints the instructions of a transaction and of a byte that is passed on.
pub fn instructions(folder: &Path) {
    let machine = Machine::start(folder, Options { counts_instructions: true, ..Options::default() });
    let bus = Bus::new([1, 2]);
    machine.wire(1, &bus);
    let mut figures = machine.figures();
    let mut client = machine.client();
    let (transaction, _) = typical(&mut figures, || drop(client.read(1, 0, 10)));
    let target = Target::AtMost(GROWTH * budget("transaction_instructions"));
    figure("qemu_transaction_instructions", transaction, "instructions", target);
    passed_on(&machine, &mut figures);
    let most = Target::AtMost(budget("stack"));
    figure("qemu_stack_icount", f64::from(figures.stack_bytes()), "bytes", most);
}

/// A write of many registers and one of few, from line to line, while they arrive.
fn passed_on(machine: &Machine, figures: &mut Figures) {
    let mut console: Console = machine.console();
    for line in [
        "delete routes",
        "port P2 serial uart2 rtu server 19200 8E1",
        "port P3 serial uart3 rtu client 19200 8E1",
        "route P2 1-10 * * P3 cut on",
    ] {
        assert_eq!(console.run(line), "", "{line}");
    }
    let bus = Bus::new([5]);
    bus.answer_after(3 * PIECE_TIME);
    machine.wire(3, &bus);
    let mut master = machine.uart(2);
    // What comes before the first silence on a line may be the end of something.
    sleep(4 * SETTLED);
    let mut write = |registers: u8| {
        let values = vec![0x55; 2 * usize::from(registers)];
        let pdu = [&[16, 0, 0, 0, registers, 2 * registers][..], &values].concat();
        let frame = rtu::frame(5, &pdu);
        for piece in frame.chunks(PIECE_BYTES) {
            master.write_all(piece).unwrap();
            sleep(PIECE_TIME); // as the line would
        }
        let mut answer = [0; 8];
        master.read_exact(&mut answer).unwrap();
        frame.len() as f64
    };
    let (mut few_bytes, mut many_bytes) = (0.0, 0.0);
    let few = typical(figures, || few_bytes = write(1));
    let many = typical(figures, || many_bytes = write(120));
    let cut = console.count("P3", "cut") as f64 / console.count("P3", "requests") as f64;
    figure("qemu_cut_through_share", 100.0 * cut, "%", Target::None);
    let bytes = many_bytes - few_bytes;
    let driver = (many.1 - few.1) / bytes;
    let gateway = (many.0 - few.0) / bytes - driver;
    figure("qemu_cut_through_instructions", gateway, "instructions/byte", Target::AtMost(PER_BYTE_MAX));
    // What DMA does on a chip.
    figure("qemu_uart_instructions", driver, "instructions/byte", Target::None);
}

/// The instructions that `act` takes, by the median of so many trials: all of them, and those of them that move the bytes of UARTs.
fn typical(figures: &mut Figures, mut act: impl FnMut()) -> (f64, f64) {
    let idle = median(figures, &mut || {});
    let active = median(figures, &mut act);
    ((active.0 - idle.0) * INSTRUCTIONS_PER_TICK, (active.1 - idle.1) * INSTRUCTIONS_PER_TICK)
}

fn median(figures: &mut Figures, act: &mut dyn FnMut()) -> (f64, f64) {
    let mut trials: Vec<(u32, u32)> = (0..TRIALS)
        .map(|_| {
            let before = figures.busy();
            act();
            // Until acknowledgements have come, and timers of the line have run out.
            sleep(SETTLED);
            let after = figures.busy();
            (after.0.wrapping_sub(before.0), after.1.wrapping_sub(before.1))
        })
        .collect();
    trials.sort_unstable();
    let (all, driver) = trials[TRIALS / 2];
    (f64::from(all), f64::from(driver))
}

/// What holds as good.
pub(crate) fn budget(name: &str) -> f64 {
    let lines = BUDGETS.lines().filter_map(|line| line.split_once(' '));
    let (_, value) = lines.into_iter().find(|(budget, _)| *budget == name).expect("a budget");
    value.trim().parse().expect("a number")
}
