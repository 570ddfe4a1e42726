// A Raspberry Pi Pico in rp2040js: the unmodified UF2 file in its flash, the functions of its ROM, and one clock for all.
import { RP2040 } from 'rp2040js';
import { Flash } from './flash.js';
import { drivePio } from './pio.js';
import { loadRom } from './rom.js';
import { loadUf2 } from './uf2.js';

const NANOS_PER_SECOND = 1e9;
const BUTTON = 22;
const HARD_FAULT = 3;
/** RP2040 data sheet 4.7.6, REASON. */
const TIMER = 1, FORCE = 2;
/** The power fails. */
const POWER = 4;

export class Board {
  /** A board whose flash holds the UF2 file `image`. */
  constructor(image) {
    this.flash = new Flash();
    this.flash.onFail = () => { this.pending = POWER; };
    loadUf2(image, this.flash.bytes);
    /** Devices at the pins: called after each start with the new chip. */
    this.devices = [];
    this.restarts = [];
    /** Whether the button is pressed. */
    this.button = false;
    /** Whether the processor stands still. */
    this.held = false;
    this.faults = [];
    this.nanosBefore = 0;
    this.start(undefined, 0);
  }

  /** Seconds since the power came. */
  get seconds() {
    return (this.nanosBefore + this.clock.nanos) / NANOS_PER_SECOND;
  }

  attach(device) {
    this.devices.push(device);
    device.attach(this.chip, this);
    return device;
  }

  /** Starts the chip, with the RAM of the run before, if there was one. */
  start(ram, reason) {
    if (this.clock) this.nanosBefore += this.clock.nanos;
    const chip = this.chip = new RP2040();
    this.clock = chip.clock;
    chip.logger = this.logger();
    chip.flash = this.flash.bytes;
    chip.flash16 = new Uint16Array(chip.flash.buffer);
    chip.flashView = new DataView(chip.flash.buffer);
    if (ram) chip.sram.set(ram);
    // From the ring oscillator, until the program has chosen another clock.
    chip.updateClocks();
    this.flash.attach(chip);
    loadRom(chip, this);
    const watchdog = chip.peripherals[0x40058];
    watchdog.reason = reason;
    watchdog.onWatchdogTrigger = () => {
      this.pending = watchdog.reason & FORCE ? FORCE : TIMER;
      // It would fire again at the same time, for ever.
      watchdog.alarm.enable = watchdog.timer.enable = false;
    };
    // VREG_AND_CHIP_RESET.CHIP_RESET: HAD_POR.
    chip.peripherals[0x40064].readUint32 = (offset) => (offset === 8 ? 1 << 8 : 0);
    // XIP_CTRL: nothing is being streamed.
    chip.peripherals[0x14000] = { readUint32: () => 0, writeUint32Atomic() {} };
    // DMA, CHAN_ABORT: an abort is over at once.
    const read = chip.dma.readUint32.bind(chip.dma);
    chip.dma.readUint32 = (offset) => (offset === 0x444 ? 0 : read(offset));
    drivePio(chip);
    // The button has a pull-up.
    chip.gpio[BUTTON].setInputValue(!this.button);
    // As the ROM leaves it, after the second stage.
    chip.core.VTOR = 0x10000100;
    chip.core.SP = chip.readUint32(chip.core.VTOR);
    chip.core.PC = chip.readUint32(chip.core.VTOR + 4) & ~1;
    this.pending = 0;
    this.held = false;
    for (const device of this.devices) device.attach(chip, this);
  }

  logger() {
    const note = (name, message) => {
      // Registers that rp2040js does not have are written at the start.
      if (this.faults.length < 20) this.faults.push(`${name}: ${message}`);
    };
    // SEV is an event for WFE, of which rp2040js only has a line in its log.
    const info = (_, message) => { if (message === 'SEV') this.chip.core.eventRegistered = true; };
    return { debug() {}, info, warn: note, error: note };
  }

  release() {
    this.button = false;
    this.chip.gpio[BUTTON].setInputValue(true);
  }

  /** The power fails for a moment. */
  powerCycle() {
    this.start(undefined, 0);
  }

  /** Raises a HardFault at `address`. */
  fault(address) {
    this.chip.core.waiting = false;
    this.chip.core.PC = address;
    this.chip.core.exceptionEntry(HARD_FAULT);
  }

  /** Calls `work` in `nanos` of simulated time. */
  after(nanos, work) {
    const alarm = this.clock.createAlarm(work);
    alarm.schedule(nanos);
    return alarm;
  }

  /** Runs until `until` says true, or for `seconds` of simulated time; says which. */
  run(seconds, until = () => false) {
    const end = this.seconds + seconds;
    for (;;) {
      const { core } = this.chip;
      for (let n = 0; n < 500; n++) {
        if (core.waiting || this.held) {
          // A nanosecond more: sums of fractions may fall short of the alarm.
          this.clock.tick(Math.min(this.clock.nextAlarm ? this.clock.nanosToNextAlarm + 1 : 1e5, 1e6));
          if (n > 50) break;
        } else {
          this.clock.tick(core.executeInstruction() * NANOS_PER_SECOND / this.chip.clkSys);
        }
        if (this.pending) break;
      }
      if (this.pending) {
        // What came just before a restart is seen too.
        until();
        this.restarts.push({ seconds: this.seconds, reason: this.pending });
        if (this.pending === POWER) this.powerCycle();
        else this.start(this.chip.sram, this.pending);
      }
      if (until()) return true;
      if (this.seconds >= end) return false;
    }
  }
}
