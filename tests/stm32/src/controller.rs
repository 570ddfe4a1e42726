//! A LAN9252 at the board's SPI, and an EtherCAT MainDevice at its cable, on the board's clock.

use std::time::Duration;

use embassy_time::Duration as WorldDuration;
use ethercat_esc::cable::SharedSegment;
use ethercat_esc::lan9252::{Pins, Timing};
use ethercat_esc::main_device::Refusal;
use ethercat_esc::master::main_device;
use ethercat_esc::sub_device::{Dispatcher, at_cable, cable, line_of};
use ethercat_esc::world::Task;
use ethercat_esc::{Lan9252, MainDevice, World};
use ethercat_subdevice::al_state::AlState;
use ethercat_subdevice::device::Device;
use ethercat_subdevice::sync_manager::Channel;
use mobgate::fieldbus::updatable_device;

use crate::foe::{FileRefusal, Writer};
use crate::machine::{Machine, Stop};
use crate::spi::Target;
use crate::time::Time;

/// The board as a SubDevice.
fn gateway() -> &'static Device {
    updatable_device(false)
}

/// How far the clocks of board and cable are apart at most.
const STEP_US: u64 = 20;
/// Longest that anything takes.
const PATIENCE: Duration = Duration::from_secs(10);

impl Target for Pins {
    fn select(&mut self, is_low: bool, at: Time) {
        Pins::select(self, is_low, at / 1_000);
    }

    fn exchange(&mut self, out: u8, at: Time) -> u8 {
        Pins::exchange(self, out, at / 1_000)
    }

    fn interrupt(&self, at: Time) -> bool {
        Pins::interrupt(self, at / 1_000)
    }
}

/// The controller, and the MainDevices.
pub struct Controller {
    world: World<'static>,
    lan9252: Lan9252,
    line: SharedSegment,
}

impl Controller {
    /// Connects one to a board that was not started yet.
    pub fn connect(machine: &Machine) -> Self {
        let world = World::new(1);
        let line = line_of(gateway());
        let lan9252 = Lan9252::new(line.borrow().chip(0), Timing::USUAL);
        machine.bus.borrow_mut().target = Some(Box::new(lan9252.pins()));
        Self { world, lan9252, line }
    }

    /// Lets board and MainDevice run for so long.
    pub fn run(&mut self, machine: &mut Machine, time: Duration) -> Result<(), Stop> {
        let end = machine.now() + time;
        while machine.now() < end {
            self.step(machine)?;
        }
        Ok(())
    }

    fn step(&mut self, machine: &mut Machine) -> Result<(), Stop> {
        self.world.run_for(WorldDuration::from_micros(STEP_US));
        machine.run(Duration::from_micros(STEP_US))
    }

    /// Lets the MainDevice do something while the board runs.
    fn carry_out<T: 'static>(
        &mut self,
        machine: &mut Machine,
        what: impl AsyncFnOnce(&mut MainDevice<'static>) -> Result<T, Refusal> + 'static,
    ) -> Result<T, Stop> {
        let mut main_device = MainDevice::new(self.line.borrow().chip(0), gateway());
        let task = self.world.spawn(async move { what(&mut main_device).await });
        let outcome = self.wait(machine, task, |_| ())?;
        outcome.map_err(|refusal| Stop::Fault(format!("the MainDevice was refused: {refusal:?}")))
    }

    /// Lets the board run until a MainDevice has done its task. `meanwhile` is called at each step.
    fn wait<T>(
        &mut self,
        machine: &mut Machine,
        task: Task<T>,
        mut meanwhile: impl FnMut(&mut Machine),
    ) -> Result<T, Stop> {
        let end = machine.now() + PATIENCE;
        while !task.is_finished() {
            if machine.now() >= end {
                return Err(Stop::Fault(format!("the MainDevice waits; the program is {}", machine.place())));
            }
            self.step(machine)?;
            meanwhile(machine);
        }
        Ok(self.world.run_until(task))
    }

    /// Lets ethercrab, a MainDevice by others, do what `script` says while the board runs, and `meanwhile` is called again and again.
    pub fn with_ethercrab<T: 'static>(
        &mut self,
        machine: &mut Machine,
        script: impl AsyncFnOnce(Dispatcher<'_>) -> T + 'static,
        meanwhile: impl FnMut(&mut Machine),
    ) -> Result<T, Stop> {
        let line = cable(self.line.clone());
        let task = self.world.spawn(at_cable(line, |pdu_loop| main_device(pdu_loop, 0), script));
        self.wait(machine, task, meanwhile)
    }

    /// Brings the board to Op.
    pub fn bring_to_op(&mut self, machine: &mut Machine) -> Result<(), Stop> {
        self.carry_out(machine, async |main_device| main_device.bring_to(AlState::Op).await)
    }

    /// Sends outputs, and zeros behind them, and takes inputs.
    pub fn exchange(&mut self, machine: &mut Machine, mut outputs: Vec<u8>) -> Result<Vec<u8>, Stop> {
        outputs.resize(gateway().default_bytes(Channel::Outputs).into(), 0);
        self.carry_out(machine, async move |main_device| main_device.exchange(&outputs).await)
    }

    /// Brings the board to Boot, and writes a file into it by FoE. What the board refused it with, if it did.
    pub fn write_file(
        &mut self,
        machine: &mut Machine,
        name: &'static str,
        file: Vec<u8>,
    ) -> Result<Option<FileRefusal>, Stop> {
        self.carry_out(machine, async move |main_device| {
            Writer::new(main_device, gateway()).update(name, &file).await
        })
    }

    /// Takes the board out of Boot, to Init.
    pub fn leave_boot(&mut self, machine: &mut Machine) -> Result<(), Stop> {
        self.carry_out(machine, async |main_device| {
            Writer::new(main_device, gateway()).reach(AlState::Init).await
        })
    }

    /// What the board did at the SPI that a LAN9252 does not allow.
    pub fn violations(&self) -> Vec<String> {
        self.lan9252.violations()
    }

    /// Resets the controller, as a brown-out does.
    pub fn reset(&mut self) {
        self.lan9252.reset();
    }
}
