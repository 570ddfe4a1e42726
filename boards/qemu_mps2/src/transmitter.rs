//! Feeds a UART's transmitter from its queue, and controls the transmit interrupt.

/// A transmitter that holds one byte, and its queue.
pub(crate) trait Transmitter {
    /// Whether it holds an unsent byte.
    fn is_full(&self) -> bool;
    /// Sends a byte.
    fn send(&self, byte: u8);
    /// Whether its interrupt is enabled.
    fn has_interrupt(&self) -> bool;
    /// Enables or disables its interrupt.
    fn set_interrupt(&self, on: bool);
    /// Takes the next byte from the queue.
    fn next(&self) -> Option<u8>;
    /// Whether the queue is empty.
    fn is_idle(&self) -> bool;
}

/// Feeds `transmitter` as far as it accepts bytes; returns whether the queue is empty. The interrupt is on while it is not.
#[inline]
pub(crate) fn transmit(transmitter: &impl Transmitter) -> bool {
    loop {
        while !transmitter.is_full() {
            let Some(byte) = transmitter.next() else { break };
            transmitter.send(byte);
        }
        let (is_idle, has_interrupt) = (transmitter.is_idle(), transmitter.has_interrupt());
        if is_idle && has_interrupt {
            transmitter.set_interrupt(false);
        }
        if is_idle || has_interrupt {
            return is_idle;
        }
        // A byte sent before this raises no interrupt, so check again.
        transmitter.set_interrupt(true);
    }
}

// Tested by the emulator's tests, which include this file: the board has no tests.
#[cfg(test)]
mod tests {
    use std::cell::{Cell, RefCell};
    use std::collections::VecDeque;

    use super::*;

    /// A transmitter whose byte leaves before the accesses set in the bit mask `leaves`.
    struct Model {
        leaves: u32,
        accesses: Cell<u32>,
        is_full: Cell<bool>,
        has_interrupt: Cell<bool>,
        is_pending: Cell<bool>,
        waiting: RefCell<VecDeque<u8>>,
        sent: RefCell<Vec<u8>>,
    }

    impl Model {
        fn new(leaves: u32, is_full: bool, bytes: &[u8]) -> Self {
            Self {
                leaves,
                accesses: Cell::new(0),
                is_full: Cell::new(is_full),
                has_interrupt: Cell::new(false),
                is_pending: Cell::new(false),
                waiting: RefCell::new(bytes.iter().copied().collect()),
                sent: RefCell::default(),
            }
        }

        fn leave(&self) {
            if self.is_full.replace(false) && self.has_interrupt.get() {
                self.is_pending.set(true);
            }
        }

        fn access(&self) {
            let access = self.accesses.replace(self.accesses.get() + 1);
            if self.leaves >> access.min(31) & 1 != 0 {
                self.leave();
            }
        }
    }

    impl Transmitter for Model {
        fn is_full(&self) -> bool {
            self.access();
            self.is_full.get()
        }

        fn send(&self, byte: u8) {
            self.access();
            assert!(!self.is_full.replace(true), "a byte was lost");
            self.sent.borrow_mut().push(byte);
        }

        fn has_interrupt(&self) -> bool {
            self.access();
            self.has_interrupt.get()
        }

        fn set_interrupt(&self, on: bool) {
            self.access();
            self.has_interrupt.set(on);
        }

        fn next(&self) -> Option<u8> {
            self.waiting.borrow_mut().pop_front()
        }

        fn is_idle(&self) -> bool {
            self.waiting.borrow().is_empty()
        }
    }

    #[test]
    fn bytes_go_on_by_interrupt_whenever_the_one_before_leaves() {
        for leaves in 0..1 << 14 {
            for is_full in [false, true] {
                let model = Model::new(leaves, is_full, b"abc");
                let mut is_idle = transmit(&model);
                while !is_idle {
                    model.leave();
                    assert!(model.is_pending.replace(false), "it stands still: {leaves:#b}, {is_full}");
                    is_idle = transmit(&model);
                }
                assert_eq!(*model.sent.borrow(), b"abc");
                assert!(!model.has_interrupt.get(), "an interrupt for nothing");
            }
        }
    }
}
