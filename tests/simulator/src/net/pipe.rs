//! One direction of a TCP connection.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::future::poll_fn;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};

use embassy_time::{Duration, Instant};
use embassy_time_driver::schedule_wake;
use embedded_io_async::ErrorKind;

use crate::random::Random;

/// How bytes travel, in both directions alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Path {
    /// From a write to its arrival.
    pub latency: Duration,
    /// Writes are cut into pieces of 1 to so many bytes, and a read gives at most one piece.
    pub piece_bytes_max: Option<usize>,
    /// Each next piece of a write arrives later by this.
    pub piece_spacing: Duration,
    /// Bytes are held back and arrive together at the multiples of this time; zero does not.
    pub coalesce: Duration,
    /// Bytes that may be under way or unread; more make the writer wait.
    pub window_bytes: usize,
}

impl Default for Path {
    /// No latency, writes arrive whole, 64 KiB of window.
    fn default() -> Self {
        let [latency, piece_spacing, coalesce] = [Duration::from_ticks(0); 3];
        Self { latency, piece_bytes_max: None, piece_spacing, coalesce, window_bytes: 65_536 }
    }
}

#[derive(Clone)]
pub(crate) struct Pipe(Rc<RefCell<State>>);

struct State {
    path: Path,
    random: Random,
    segments: VecDeque<Segment>,
    held_bytes: usize,
    end: End,
    last_arrival: Instant,
    /// Readers and writers alike: any change is worth a look by all.
    waiting: Vec<Waker>,
}

struct Segment {
    arrival: Instant,
    bytes: VecDeque<u8>,
}

/// How the direction ends.
#[derive(Clone, Copy, PartialEq, Eq)]
enum End {
    Open,
    /// Nothing comes behind what is under way.
    Finished,
    /// The reader has gone: what is written is answered by a reset.
    Abandoned,
    Reset,
    /// The other side does not exist any more, and nothing says so.
    Silent,
}

impl Pipe {
    pub(super) fn new(path: Path, random: Random) -> Self {
        Self(Rc::new(RefCell::new(State {
            path,
            random,
            segments: VecDeque::new(),
            held_bytes: 0,
            end: End::Open,
            last_arrival: Instant::from_ticks(0),
            waiting: Vec::new(),
        })))
    }

    pub(super) fn finish(&self) {
        self.end(End::Finished);
    }

    pub(super) fn abandon(&self) {
        self.end(End::Abandoned);
    }

    pub(super) fn reset(&self) {
        self.0.borrow_mut().segments.clear();
        self.end(End::Reset);
    }

    pub(super) fn go_silent(&self) {
        self.end(End::Silent);
    }

    /// The first end counts, but a reset overrides all others.
    fn end(&self, end: End) {
        let mut state = self.0.borrow_mut();
        if state.end == End::Open || end == End::Reset {
            state.end = end;
        }
        state.wake_all();
    }

    pub(crate) async fn read(&self, into: &mut [u8]) -> Result<usize, ErrorKind> {
        poll_fn(|context| self.0.borrow_mut().poll_read(context, into)).await
    }

    pub(super) async fn write(&self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        poll_fn(|context| self.0.borrow_mut().poll_write(context, bytes)).await
    }

    /// Waits until the reader's acknowledgement of the last byte is back.
    pub(super) async fn acknowledged(&self) -> Result<(), ErrorKind> {
        let (arrival, back) = {
            let state = self.0.borrow();
            (state.last_arrival, state.path.latency)
        };
        if arrival + back > Instant::now() {
            embassy_time::Timer::at(arrival + back).await;
        }
        if self.0.borrow().end == End::Reset { Err(ErrorKind::ConnectionReset) } else { Ok(()) }
    }
}

impl State {
    fn poll_read(&mut self, context: &mut Context<'_>, into: &mut [u8]) -> Poll<Result<usize, ErrorKind>> {
        if self.end == End::Reset {
            return Poll::Ready(Err(ErrorKind::ConnectionReset));
        }
        let count = self.take(into);
        if count > 0 || into.is_empty() {
            self.wake_all();
            return Poll::Ready(Ok(count));
        }
        match self.segments.front() {
            Some(segment) => schedule_wake(segment.arrival.as_ticks(), context.waker()),
            None if matches!(self.end, End::Finished | End::Abandoned) => return Poll::Ready(Ok(0)),
            None => {}
        }
        self.wait(context);
        Poll::Pending
    }

    /// Moves what has arrived, one piece or as much as there is.
    fn take(&mut self, into: &mut [u8]) -> usize {
        let now = Instant::now();
        let mut count = 0;
        while let Some(segment) = self.segments.front_mut().filter(|segment| segment.arrival <= now) {
            for place in &mut into[count..] {
                let Some(byte) = segment.bytes.pop_front() else { break };
                *place = byte;
                count += 1;
            }
            if !segment.bytes.is_empty() {
                break;
            }
            self.segments.pop_front();
            if self.path.piece_bytes_max.is_some() {
                break;
            }
        }
        self.held_bytes -= count;
        count
    }

    fn poll_write(&mut self, context: &mut Context<'_>, bytes: &[u8]) -> Poll<Result<usize, ErrorKind>> {
        match self.end {
            End::Reset | End::Abandoned => return Poll::Ready(Err(ErrorKind::ConnectionReset)),
            End::Finished => return Poll::Ready(Err(ErrorKind::BrokenPipe)),
            End::Open | End::Silent => {}
        }
        let count = bytes.len().min(self.path.window_bytes - self.held_bytes);
        if count == 0 && !bytes.is_empty() {
            self.wait(context);
            return Poll::Pending;
        }
        let mut rest = &bytes[..count];
        let mut arrival = Instant::now() + self.path.latency;
        while !rest.is_empty() {
            let most = self.path.piece_bytes_max.unwrap_or(usize::MAX).min(rest.len());
            let length = match self.path.piece_bytes_max {
                Some(_) => 1 + self.random.index(most),
                None => most,
            };
            let (piece, behind) = rest.split_at(length);
            self.send(arrival, piece);
            arrival += self.path.piece_spacing;
            rest = behind;
        }
        self.wake_all();
        Poll::Ready(Ok(count))
    }

    fn send(&mut self, arrival: Instant, piece: &[u8]) {
        let step = self.path.coalesce.as_ticks();
        let arrival = match step {
            0 => arrival,
            step => Instant::from_ticks(arrival.as_ticks().next_multiple_of(step)),
        };
        // A stream keeps its order.
        let arrival = arrival.max(self.last_arrival);
        self.last_arrival = arrival;
        self.held_bytes += piece.len();
        self.segments.push_back(Segment { arrival, bytes: piece.iter().copied().collect() });
    }

    fn wait(&mut self, context: &Context<'_>) {
        if !self.waiting.iter().any(|waker| waker.will_wake(context.waker())) {
            self.waiting.push(context.waker().clone());
        }
    }

    fn wake_all(&mut self) {
        self.waiting.drain(..).for_each(Waker::wake);
    }
}
