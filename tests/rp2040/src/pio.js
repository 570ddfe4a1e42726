// Runs rp2040js's PIO state machines by the simulated clock: each steps when its divided clock ticks. rp2040js itself steps them by
// the host's timers, apart from the processor.

export function drivePio(chip) {
  for (const pio of chip.pio) {
    pio.run = () => {};
    const machines = pio.machines.map((machine) => drive(chip, pio, machine));
    const write = pio.writeUint32.bind(pio);
    pio.writeUint32 = (offset, value) => {
      write(offset, value);
      for (const machine of machines) machine.look();
    };
  }
}

function drive(chip, pio, machine) {
  const ticks = () => {
    const divider = (machine.clockDivInt || 65536) + machine.clockDivFrac / 256;
    return divider * 1e9 / chip.clkSys;
  };
  /** Time of the next step, and whether one is due. */
  let next = 0;
  const alarm = chip.clock.createAlarm(() => {
    alarm.scheduled = false;
    if (!machine.enabled || machine.waiting) return;
    const before = machine.cycles;
    machine.step();
    pio.checkChangedPins();
    if (machine.waiting) return;
    next += (machine.cycles - before) * ticks();
    alarm.schedule(Math.max(0, next - chip.clock.nanos));
  });
  const look = () => {
    if (machine.enabled && !machine.waiting && !alarm.scheduled) {
      next = chip.clock.nanos;
      alarm.schedule(0);
    } else if (!machine.enabled && alarm.scheduled) {
      alarm.cancel();
    }
  };
  // A stalled instruction completes when a FIFO or a pin changes; the next one follows after its delay.
  const check = machine.checkWait.bind(machine);
  machine.checkWait = () => {
    const before = machine.cycles;
    const waited = machine.waiting;
    check();
    if (waited && !machine.waiting && machine.enabled && !alarm.scheduled) {
      pio.checkChangedPins();
      next = chip.clock.nanos + Math.max(1, machine.cycles - before) * ticks();
      alarm.schedule(next - chip.clock.nanos);
    }
  };
  return { look };
}
