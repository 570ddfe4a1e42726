//! A simulated LAN9252 at the board's SPI, and MainDevices at its cable, in a thread of their own on the wall clock.
//!
//! The board's transactions come by one pipe and go back by another (boards/qemu_mps2/src/ethercat/spi.rs says how). The board
//! stands still while it waits for one, so the thread responds at once, and as long as the controller lives.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use embassy_futures::block_on;
use embassy_time::Timer;
use embedded_hal::spi::Operation;
use embedded_hal_async::spi::SpiDevice;
use ethercat_subdevice::device::Device;
use mobgate::fieldbus::DEVICE;
use mobgate_simulator::Lan9252;
use mobgate_simulator::esc::SharedSegment;
use mobgate_simulator::esc::master::patient_main_device;
use mobgate_simulator::lan9252::{Spi, Timing};
use mobgate_simulator::sub_device::{Dispatcher, at_cable, cable, line_of};
use mobgate_simulator::wall_clock::run_beside;
use nix::sys::stat::Mode;

static GATEWAY: Device = DEVICE;

/// Bytes before those of a transaction: their number, and the number of the request.
const HEAD_BYTES: usize = 3;
/// ethercrab keeps a list of all objects that there could be on the stack, more than once.
const STACK_BYTES: usize = 16 << 20;
/// Between two looks for the next MainDevice.
const JOBS_INTERVAL_MS: u64 = 10;
/// Longest that a MainDevice may take for all that it does.
const SCRIPT_LIMIT: Duration = Duration::from_secs(300);

type Job = Box<dyn FnOnce(&mut Wires) + Send>;

/// The controller; without it the board's SPI leads nowhere.
pub struct Controller {
    pipes: PathBuf,
    /// Closed to end the thread.
    jobs: Option<Sender<Job>>,
    thread: Option<JoinHandle<()>>,
}

impl Controller {
    /// Starts a controller behind two pipes in `folder`, which are made when they are not there.
    pub fn start(folder: &Path) -> Self {
        let pipes = folder.join("spi");
        for end in ["in", "out"] {
            match nix::unistd::mkfifo(&pipes.with_extension(end), Mode::S_IRWXU) {
                Ok(()) | Err(nix::errno::Errno::EEXIST) => {}
                Err(error) => panic!("a pipe: {error}"),
            }
        }
        let (jobs, todo) = channel();
        let path = pipes.clone();
        // Both are open before this returns: opening a pipe waits for its other end.
        let (opened, is_open) = channel();
        let thread = thread::Builder::new().stack_size(STACK_BYTES).spawn(move || {
            let mut wires = Wires::open(&path);
            opened.send(()).unwrap();
            wires.serve(&todo);
        });
        is_open.recv().expect("pipes that can be opened");
        Self { pipes, jobs: Some(jobs), thread: Some(thread.unwrap()) }
    }

    /// What the board must be told to use it.
    pub fn word(&self) -> String {
        format!("spi={}", self.pipes.display())
    }

    /// A MainDevice that does as `script` says.
    ///
    /// # Panics
    /// When the script does, or never ends.
    pub fn run<T: Send + 'static>(
        &self,
        script: impl AsyncFnOnce(Dispatcher<'_>) -> T + Send + 'static,
    ) -> T {
        let (sender, result) = channel();
        let job: Job = Box::new(move |wires| {
            let line = wires.line.clone();
            let value = wires.run(at_cable(cable(line), patient_main_device, script));
            let _ = sender.send(value);
        });
        self.jobs.as_ref().unwrap().send(job).expect("a controller that lives");
        result.recv_timeout(SCRIPT_LIMIT).expect("the MainDevice's script comes to its end")
    }
}

impl Drop for Controller {
    fn drop(&mut self) {
        drop(self.jobs.take());
        // A panic of the thread has been told by itself.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// What the thread has.
struct Wires {
    line: SharedSegment,
    lan9252: Lan9252,
    spi: Spi,
    from_board: File,
    to_board: File,
    begun: Vec<u8>,
}

impl Wires {
    fn open(path: &Path) -> Self {
        // With both directions, so that opening does not wait for the board.
        let open = |end: &str| {
            let mut options = OpenOptions::new();
            options.read(true).write(true).custom_flags(nix::libc::O_NONBLOCK);
            options.open(path.with_extension(end)).expect("a pipe")
        };
        let line = line_of(&GATEWAY);
        let lan9252 = Lan9252::new(line.borrow().chip(0), Timing::NONE);
        let spi = lan9252.spi();
        // The board knows a response to a request that a controller before this one has left by its number.
        Self { line, lan9252, spi, from_board: open("out"), to_board: open("in"), begun: Vec::new() }
    }

    /// Serves the board, and does `jobs` meanwhile, until there will be no more.
    fn serve(&mut self, jobs: &Receiver<Job>) {
        loop {
            let next = self.run(async {
                loop {
                    match jobs.try_recv() {
                        Ok(job) => return Some(job),
                        Err(TryRecvError::Disconnected) => return None,
                        Err(TryRecvError::Empty) => Timer::after_millis(JOBS_INTERVAL_MS).await,
                    }
                }
            });
            let Some(job) = next else { return };
            job(self);
            self.lan9252.check();
        }
    }

    /// Serves the board until `future` is done.
    fn run<T>(&mut self, future: impl Future<Output = T>) -> T {
        let Self { lan9252, spi, from_board, to_board, begun, .. } = self;
        let source = from_board.try_clone().unwrap();
        let respond = || respond(from_board, to_board, begun, lan9252, spi);
        run_beside(&[source.as_fd()], respond, future).expect("pipes")
    }
}

/// Answers the board's next transaction, if it is there.
fn respond(
    from_board: &mut File,
    to_board: &mut File,
    begun: &mut Vec<u8>,
    lan9252: &Lan9252,
    spi: &mut Spi,
) -> io::Result<bool> {
    let mut chunk = [0; 2048];
    match from_board.read(&mut chunk) {
        Ok(count) => begun.extend_from_slice(&chunk[..count]),
        Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(false),
        Err(error) => return Err(error),
    }
    while let Some((&[low, high, number], rest)) = begun.split_first_chunk::<HEAD_BYTES>() {
        let length = usize::from(u16::from_le_bytes([low, high]));
        let Some(mut bytes) = rest.get(..length).map(<[u8]>::to_vec) else { break };
        begun.drain(..HEAD_BYTES + length);
        if bytes.is_empty() {
            bytes.push(lan9252.interrupt_is_high().into());
        } else {
            // Nothing takes time there, so this does not wait.
            block_on(spi.transaction(&mut [Operation::TransferInPlace(&mut bytes)]))
                .map_err(|_| io::Error::from(ErrorKind::Other))?;
        }
        let [low, high] = (bytes.len() as u16).to_le_bytes();
        // In one piece, which a pipe takes whole.
        to_board.write_all(&[&[low, high, number], &bytes[..]].concat())?;
    }
    Ok(true)
}
