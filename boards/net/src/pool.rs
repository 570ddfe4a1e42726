//! The board's sockets: one buffer each, lent to a connection and returned once embassy-net has released the socket.

use core::cell::{Cell, RefCell};
use core::mem::forget;
use core::ptr::NonNull;
use core::slice;

use embassy_net::Stack;
use embassy_net::tcp::TcpSocket;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use mobgate::hal::{OpenError, OpenErrorKind};

use crate::SOCKETS_MAX;
use crate::backlog::Backlog;
use crate::closing::end;
#[cfg(feature = "ssh")] // Images without it have no console by network; also below.
use crate::lobby::Lobby;

/// The sockets that a board can have open at a time.
///
/// The stack's resources need a slot for each of them and some for its own use: `StackResources<{ SOCKETS + STACK_SOCKETS }>`.
pub struct Sockets {
    pub(crate) stack: Stack<'static>,
    pub(crate) backlog: &'static Backlog,
    /// The first buffer; the others follow.
    buffers: NonNull<u8>,
    buffer_bytes: usize,
    /// A bit for each free buffer.
    free: Cell<u32>,
    /// Dropped connections, whose peers are still to be told, by the numbers of their buffers.
    dropped: RefCell<[Option<TcpSocket<'static>>; SOCKETS_MAX]>,
    news: Signal<NoopRawMutex, ()>,
    #[cfg(feature = "ssh")]
    pub(crate) lobby: Lobby<PooledTcp>,
}

impl Sockets {
    /// One socket of `stack` for each of `buffers`, up to [`SOCKETS_MAX`]. Half of a buffer is for receiving, half for sending. SYNs
    /// that the stack's driver receives wait in `backlog`.
    pub fn new<const N: usize>(
        stack: Stack<'static>,
        backlog: &'static Backlog,
        buffers: &'static mut [[u8; N]],
    ) -> Self {
        // A bit for each.
        let free = Cell::new(((1_u64 << buffers.len().min(SOCKETS_MAX)) - 1) as u32);
        let buffers = NonNull::from(buffers.as_flattened_mut()).cast();
        let dropped = RefCell::new([const { None }; SOCKETS_MAX]);
        Self {
            stack,
            backlog,
            buffers,
            buffer_bytes: N,
            free,
            dropped,
            news: Signal::new(),
            #[cfg(feature = "ssh")]
            lobby: Lobby::new(),
        }
    }

    /// The sockets' network stack.
    pub fn stack(&self) -> Stack<'static> {
        self.stack
    }

    /// Number of sockets that could be opened now.
    pub fn free(&self) -> usize {
        self.free.get().count_ones() as usize
    }

    /// Closes connections that were dropped without closing; never returns. Their peers would wait in vain otherwise.
    pub async fn run(&'static self) -> ! {
        loop {
            match self.next_dropped() {
                Some(mut socket) => end(socket.get()).await,
                None => self.news.wait().await,
            }
        }
    }

    fn next_dropped(&'static self) -> Option<PooledTcp> {
        let mut dropped = self.dropped.borrow_mut();
        let number = dropped.iter().position(Option::is_some)?;
        Some(PooledTcp { socket: dropped[number].take()?, lease: Lease { sockets: self, number } })
    }

    /// A TCP socket, if one is free.
    pub(crate) fn tcp(&'static self) -> Result<PooledTcp, OpenError> {
        Lease::take(self).map(PooledTcp::new)
    }
}

/// A TCP socket and its buffer. Fields drop in order, so the buffer is returned after the socket is gone.
pub(crate) struct PooledTcp {
    socket: TcpSocket<'static>,
    lease: Lease,
}

impl PooledTcp {
    /// A socket with the buffer of `lease`.
    pub(crate) fn new(mut lease: Lease) -> Self {
        let (receive, transmit) = lease.halves();
        Self { socket: TcpSocket::new(lease.sockets.stack, receive, transmit), lease }
    }

    /// The pool that it is of.
    #[cfg(feature = "ssh")]
    pub(crate) fn sockets(&self) -> &'static Sockets {
        self.lease.sockets
    }

    pub(crate) fn get(&mut self) -> &mut TcpSocket<'static> {
        &mut self.socket
    }

    /// Leaves closing the connection to [`Sockets::run`].
    pub(crate) fn end_later(self) {
        let Self { mut socket, lease } = self;
        socket.close();
        lease.sockets.dropped.borrow_mut()[lease.number] = Some(socket);
        lease.sockets.news.signal(());
        // It is the dropped socket's now.
        forget(lease);
    }
}

/// A buffer on loan from the pool, returned on drop.
pub(crate) struct Lease {
    sockets: &'static Sockets,
    pub(crate) number: usize,
}

impl Lease {
    /// A buffer of the pool, if one is free.
    pub(crate) fn take(sockets: &'static Sockets) -> Result<Self, OpenError> {
        let free = sockets.free.get();
        if free == 0 {
            return Err(OpenError::new(OpenErrorKind::Exhausted, ""));
        }
        // Without the lowest of its bits.
        sockets.free.set(free & (free - 1));
        Ok(Self { sockets, number: free.trailing_zeros() as usize })
    }

    /// The two halves of the buffer, for one socket that is dropped before the lease.
    pub(crate) fn halves(&mut self) -> (&'static mut [u8], &'static mut [u8]) {
        let bytes = self.sockets.buffer_bytes;
        // SAFETY: a lease's number is that of a buffer, and the pool has them all from a `&'static mut`. Only this lease has the
        // number. This is called once per lease, and both owners of a lease declare the socket with the halves before the lease, or
        // borrow from it.
        #[allow(unsafe_code)]
        let buffer = unsafe {
            slice::from_raw_parts_mut(self.sockets.buffers.add(self.number * bytes).as_ptr(), bytes)
        };
        buffer.split_at_mut(bytes / 2)
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        self.sockets.backlog.leaves(self.number);
        self.sockets.free.update(|free| free | 1 << self.number);
    }
}
