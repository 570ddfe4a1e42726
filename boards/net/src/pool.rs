//! The board's sockets: one buffer each, lent to a connection and returned once embassy-net has released the socket.

use core::cell::RefCell;
use core::ptr::NonNull;

use embassy_net::Stack;
use embassy_net::tcp::TcpSocket;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use heapless::Vec;
use mobgate::hal::{OpenError, OpenErrorKind};

use crate::closing::end;

/// Most sockets in a pool.
pub const SOCKETS_MAX: usize = 24;

/// The sockets that a board can have open at a time.
///
/// The stack's resources need a slot for each of them and some for its own use: `StackResources<{ SOCKETS + STACK_SOCKETS }>`.
pub struct Sockets {
    pub(crate) stack: Stack<'static>,
    free: RefCell<Vec<&'static mut [u8], SOCKETS_MAX>>,
    /// Dropped connections, whose peers are still to be told.
    dropped: RefCell<Vec<PooledTcp, SOCKETS_MAX>>,
    news: Signal<NoopRawMutex, ()>,
}

impl Sockets {
    /// One socket of `stack` for each of `buffers`, up to [`SOCKETS_MAX`]. Half of a buffer is for receiving, half for sending.
    pub fn new(stack: Stack<'static>, buffers: impl IntoIterator<Item = &'static mut [u8]>) -> Self {
        let free = RefCell::new(buffers.into_iter().take(SOCKETS_MAX).collect());
        Self { stack, free, dropped: RefCell::default(), news: Signal::new() }
    }

    /// The sockets' network stack.
    pub fn stack(&self) -> Stack<'static> {
        self.stack
    }

    /// Number of sockets that could be opened now.
    pub fn free(&self) -> usize {
        self.free.borrow().len()
    }

    /// Closes connections that were dropped without closing; never returns. Their peers would wait in vain otherwise.
    pub async fn run(&self) -> ! {
        loop {
            let next = self.dropped.borrow_mut().pop();
            match next {
                Some(mut socket) => end(socket.get()).await,
                None => self.news.wait().await,
            }
        }
    }

    /// A TCP socket, if one is free.
    pub(crate) fn tcp(&'static self) -> Result<PooledTcp, OpenError> {
        let mut lease = Lease::take(self)?;
        let (receive, transmit) = lease.halves();
        Ok(PooledTcp { socket: TcpSocket::new(self.stack, receive, transmit), lease })
    }

    /// Leaves closing a connection to [`run`](Self::run).
    pub(crate) fn end_later(&self, mut socket: PooledTcp) {
        socket.get().close();
        // As many slots as sockets, so it fits. Otherwise the socket would vanish silently.
        let _ = self.dropped.borrow_mut().push(socket);
        self.news.signal(());
    }
}

/// A TCP socket and its buffer. Fields drop in order, so the buffer is returned after the socket is gone.
pub(crate) struct PooledTcp {
    socket: TcpSocket<'static>,
    lease: Lease,
}

impl PooledTcp {
    pub(crate) fn get(&mut self) -> &mut TcpSocket<'static> {
        &mut self.socket
    }

    pub(crate) fn sockets(&self) -> &'static Sockets {
        self.lease.sockets
    }
}

/// A buffer on loan from the pool, returned on drop.
pub(crate) struct Lease {
    sockets: &'static Sockets,
    buffer: NonNull<[u8]>,
}

impl Lease {
    /// A buffer of the pool, if one is free.
    pub(crate) fn take(sockets: &'static Sockets) -> Result<Self, OpenError> {
        let buffer = sockets.free.borrow_mut().pop();
        let buffer = buffer.ok_or(OpenError::new(OpenErrorKind::Exhausted, ""))?;
        Ok(Self { sockets, buffer: NonNull::from(buffer) })
    }

    /// The two halves of the buffer, for one socket that is dropped before the lease.
    pub(crate) fn halves(&mut self) -> (&'static mut [u8], &'static mut [u8]) {
        // SAFETY: the buffer came from a `&'static mut` that only this lease has. This is called once per lease, and both owners of
        // a lease declare the socket with the halves before the lease, or borrow from it.
        #[allow(unsafe_code)]
        let buffer = unsafe { self.buffer.as_mut() };
        buffer.split_at_mut(buffer.len() / 2)
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        // SAFETY: the socket with the halves is gone (see `halves`), so this is the only reference again.
        #[allow(unsafe_code)]
        let buffer = unsafe { self.buffer.as_mut() };
        // It was taken from there, so it fits.
        let _ = self.sockets.free.borrow_mut().push(buffer);
    }
}
