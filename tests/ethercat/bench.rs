//! The bench for SubDevices, and the gateway's objects on it.

use crate::prelude::*;

pub(crate) use mobgate_simulator::esc::bench::*;

/// The gateway as a device, with images of the usual size.
pub(crate) static GATEWAY: Device = DEVICE;

/// The gateway with [`gateway_objects`], in `state`.
pub(crate) fn gateway_in(state: u16) -> Rig<GatewayObjects<'static>> {
    let mut rig = Rig::with_application(&GATEWAY, gateway_objects());
    rig.bring_to(state);
    rig
}

/// The ESI file of `device` alone.
pub(crate) fn esi_of(device: &Device) -> String {
    let mut file = String::new();
    esi::write(device, &mut file).unwrap();
    file
}

/// The EEPROM's content of `device`.
pub(crate) fn sii_of(device: &Device) -> [u8; sii::SII_BYTES] {
    let mut image = [0; sii::SII_BYTES];
    sii::write(device, &mut image).unwrap();
    image
}

/// Switches a SyncManager off, and writes its registers with a change.
pub(crate) fn set_anew<A: Application + 'static>(
    rig: &mut Rig<A>,
    channel: Channel,
    change: impl FnOnce(&mut [u8; 8]),
) {
    let mut block = rig.sync_manager(channel);
    change(&mut block);
    rig.write(channel.registers() + 6, &[0]);
    assert_eq!(rig.write(channel.registers(), &block), 1);
}

/// `device` with this application, and ethercrab, which does as `script` says.
pub(crate) fn with_ethercrab(
    device: &'static Device,
    application: impl Application,
    script: impl AsyncFnOnce(Dispatcher<'_>),
) {
    let mut world = World::new(1);
    let line = line_of(device);
    let chip = line.borrow().chip(0);
    let signals = note_pulses(&world, &chip, Duration::MIN);
    let (esc, interrupt) = direct(chip);
    spawn(&world, SubDevice::new(device, esc, application).with_sync(Some(signals)), interrupt);
    with_master(&mut world, cable(line), script);
}

/// A device behind an SPI, once its chip is ready, and the chip.
pub(crate) fn behind_spi(interrupt: InterruptPin, timing: Timing) -> (Rig<Bench>, Lan9252) {
    let mut used = None;
    let reach = |chip| {
        let (driver, line, lan9252) = lan9252_with(chip, interrupt, timing);
        used = Some(lan9252);
        (driver, line)
    };
    let mut rig = Rig::reached_by(&MAILBOX_128, Bench::default(), Duration::from_millis(2), reach);
    rig.pass(100);
    (rig, used.unwrap())
}

/// A device in Op whose processor works in pieces with random pauses of up to `pause_us` between them; it is waited for as long as
/// `wait` after each frame.
pub(crate) fn slow_device(seed: u64, pause_us: u64, wait: Duration) -> (Rig<SharedEcho>, SharedEcho) {
    let echo = SharedEcho::default();
    let reach = |chip| {
        let (esc, interrupt) = direct(chip);
        (Paced::new(esc, Random::new(seed), 0..=pause_us), interrupt)
    };
    let mut rig = Rig::reached_by(&MAILBOX_128, echo.clone(), wait, reach);
    rig.bring_to(SAFE_OP);
    rig.exchange(&image(1, 120));
    assert_eq!(rig.request(OP), (OP, 0));
    (rig, echo)
}

/// The gateway's objects, with a port that never asks.
pub(crate) fn gateway_objects() -> GatewayObjects<'static> {
    GatewayObjects::new(place_with("port ecat ethercat"))
}

/// Prints a figure, and demands that it is at most so much.
pub(crate) fn at_most(name: &str, value: u64, unit: &str, most: u64) {
    let verdict = if value <= most { "ok" } else { "short" };
    // The name of the test is on this line already where tests run one by one.
    println!("\nfigure {name} {value} {unit} <={most} {verdict}");
    assert!(value <= most, "{name}: {value} {unit}");
}

/// What a gateway with such settings shares with its SubDevice.
pub(crate) fn place_with(lines: &str) -> &'static EthercatState {
    // A place is there for as long as the gateway runs: here, as long as the test.
    let place = Box::leak(Box::new(EthercatState::new()));
    let settings = settings_of(lines);
    place.follow(&settings, !settings.slaves.is_empty());
    place
}

/// What the MainDevice is told that an access was aborted with.
pub(crate) fn abort_code(outcome: Result<(), Error>) -> Option<u32> {
    match outcome {
        Err(Error::Mailbox(MailboxError::Aborted { code, .. })) => Some(code.into()),
        _ => None,
    }
}
