//! What goes wrong with a board: power, clocks, a PHY that hangs, a program that was misled.

use crate::chip::Family;
use crate::gpio::{BUTTON, Drive};
use crate::machine::Machine;

impl Machine {
    /// Erasures and programmings of the flash since the first power-up.
    pub fn flash_operations(&self) -> usize {
        self.bus.borrow().flash.cells.operations
    }

    /// Cuts the power in the middle of a later operation of the flash: 0 is the next one. The run stops there.
    pub fn cut_power_at(&mut self, operation: usize) {
        let mut bus = self.bus.borrow_mut();
        bus.flash.cells.cut_at = Some(bus.flash.cells.operations + operation);
    }

    /// Leaves the power on after all.
    pub fn keep_power(&mut self) {
        self.bus.borrow_mut().flash.cells.cut_at = None;
    }

    /// Puts zeros where the settings will be, as another program may have left them.
    pub fn soil_flash(&mut self) {
        let (settings, sector) = self.board.settings;
        self.bus.borrow_mut().flash.cells.put(settings, &vec![0; 2 * sector as usize]);
    }

    /// From now on the PHY never ends an access, or does so again.
    pub fn hang_phy(&mut self, hangs: bool) {
        self.bus.borrow_mut().ethernet.phy.hangs = hangs;
    }

    /// The PHY responds no more, and gives no clock from the next reset on.
    pub fn remove_phy(&mut self) {
        self.bus.borrow_mut().ethernet.phy.is_there = false;
    }

    /// The noise of which random numbers are made fails, or is there again.
    pub fn spoil_noise(&mut self, fails: bool) {
        self.bus.borrow_mut().random.is_spoilt = fails;
    }

    /// Presses the user button, or lets it go.
    pub fn press_button(&mut self, is_pressed: bool) {
        self.bus.borrow_mut().gpio.driven().insert(BUTTON, Drive::Level(is_pressed));
    }

    /// Plugs the Ethernet cable in or pulls it out.
    pub fn plug_cable(&mut self, is_in: bool) {
        self.bus.borrow_mut().ethernet.phy.has_cable = is_in;
    }

    /// Frames from the network for which the program had no room.
    pub fn frames_dropped(&self) -> usize {
        self.bus.borrow().ethernet.dropped
    }

    /// Lets the program go on where there is no memory, as after a flipped bit.
    pub fn mislead(&mut self, address: u32) {
        self.cpu.jump(address);
    }

    /// Lets the program go on where a function panics; gives the address of its call.
    pub fn panic(&mut self) -> u32 {
        let call = self.image.call_of("core::panicking::panic_fmt", self.board.active.0);
        let call = call.expect("some function panics");
        self.cpu.jump(call);
        call
    }

    /// Makes the chip one of this revision, as DBGMCU tells it; for a board that was not started yet.
    pub fn set_revision(&mut self, revision: u16) {
        self.bus.borrow_mut().revision = revision;
    }

    /// Makes an F7's flash two banks (nDBANK = 0); for a board that was not started yet.
    pub fn split_flash(&mut self) {
        self.bus.borrow_mut().flash.cells.is_one_bank = false;
        self.power_cycle();
        self.resets.clear();
    }

    /// Whether the caches of instructions and of data are on: the Cortex-M7's; or those at the F4's flash, with its prefetch.
    pub fn caches(&self) -> (bool, bool) {
        let bus = self.bus.borrow();
        let caches = &bus.core.caches;
        if bus.board.family == Family::F4 { bus.flash.caches() } else { (caches.instructions, caches.data) }
    }

    /// Whether the H7 reads its AXI SRAM for one master at a time (READ_ISS_OVERRIDE).
    pub fn reads_for_one_master(&self) -> bool {
        self.bus.borrow().axi.get(0x108) & 1 != 0
    }

    /// Raises an NMI, as a clock that failed does.
    pub fn raise_nmi(&mut self) {
        /// The exception's number.
        const NMI: usize = 2;
        self.cpu.enter(NMI);
    }
}
