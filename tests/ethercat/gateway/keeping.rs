//! The configuration survives a restart: saved on the MainDevice's command, or at the console, as lines of the settings.

use std::cell::Cell;

use embassy_futures::join::join;
use mobgate::gateway::Gateway;
use mobgate::gateway::saved::write_store;
use mobgate::hal::{Store, StoreError};
use mobgate::language::LineBuffer;

use super::bench::{Bench, MS, SETUP, with_devices, with_wire};
use super::objects::{SETTINGS, layout, objects, read, reason, write};
use super::virtual_devices::{Virtual, virtual_devices};
use crate::prelude::*;

const SAVE: u32 = 0x6576_6173;
const LOAD: u32 = 0x6461_6f6c;
/// What a flash may take.
const SLOW: Duration = Duration::from_millis(400);

/// A store that takes its time, and may fail; clones are handles of the same.
#[derive(Clone, Default)]
struct SlowStore {
    next: Rc<RefCell<String>>,
    saved: Rc<RefCell<Option<String>>>,
    /// How often it fails before it does not.
    failures: Rc<Cell<u32>>,
}

impl Store for SlowStore {
    async fn read(&mut self, _offset: usize, _into: &mut [u8]) -> Result<usize, StoreError> {
        Ok(0)
    }

    async fn append(&mut self, text: &[u8]) -> Result<(), StoreError> {
        Timer::after_micros(100).await;
        self.next.borrow_mut().push_str(str::from_utf8(text).unwrap());
        Ok(())
    }

    async fn commit(&mut self) -> Result<(), StoreError> {
        Timer::after(SLOW).await;
        if let Some(left) = self.failures.get().checked_sub(1) {
            self.failures.set(left);
            return Err(StoreError::Failed);
        }
        *self.saved.borrow_mut() = Some(self.next.take());
        Ok(())
    }
}

impl SlowStore {
    fn failing(times: u32) -> Self {
        Self { failures: Rc::new(Cell::new(times)), ..Self::default() }
    }

    fn saved(&self) -> Option<String> {
        self.saved.borrow().clone()
    }
}

/// Runs `script` while `store` serves the gateway.
async fn with_store(gateway: &Gateway<'_>, store: &SlowStore, script: impl Future<Output = ()>) {
    let mut store = store.clone();
    match select(gateway.keep_settings(&mut store), script).await {
        Either::First(()) => panic!("it serves for ever"),
        Either::Second(()) => {}
    }
}

/// Runs `script` with a MainDevice, and the gateway that `store` serves.
fn with_kept(settings: &str, store: &SlowStore, script: impl AsyncFnOnce(Dispatcher<'_>, &Gateway<'_>)) {
    with_wire(115_200, settings, Vec::new(), async |dispatcher, gateway| {
        with_store(gateway, store, script(dispatcher, gateway)).await;
    });
}

#[test]
fn statement_56_a_configuration_is_saved_on_command_while_process_data_go_on_and_is_in_use_after_a_restart() {
    let store = SlowStore::default();
    let virtuals = virtual_devices();
    let devices: Vec<_> = virtuals.iter().map(Virtual::device).collect();
    let settings =
        SETTINGS.replace("19200 8E1", "115200 8E1").replace("ecat ethercat", "ecat ethercat line bus");
    let wired = devices.clone();
    with_wire(115_200, &settings, wired, async |dispatcher, gateway| {
        let bench = Bench { dispatcher, setup: SETUP, virtuals: virtual_devices(), devices };
        with_store(gateway, &store, save_in_op(&bench)).await;
    });
    let text = store.saved().expect("it was saved");
    let slave = "\nslave 0 unit 232 coil 10 count 18 discrete 10010 count 3 input 30010 count 6";
    assert!(text.contains(slave), "{text}");

    // The power comes back.
    with_gateway(1, &text, |world, rig| {
        for device in &virtuals {
            rig.attach(world, "uart1", [device.device()]);
        }
        let place = rig.gateway.ethercat().unwrap();
        let mut objects = GatewayObjects::new(place);
        assert_eq!(read(&mut objects, 0x2005, 2), 1, "it is in use at once");
        assert_eq!((read(&mut objects, 0x2000, 1), read(&mut objects, 0x2020, 1)), (4, 115_200));
        for (device, nth) in virtuals.iter().zip(0..) {
            assert_eq!(layout(&mut objects, nth), device.layout);
            assert_eq!(read(&mut objects, 0x2001 + nth, 10), SETUP.polling_ms);
        }
        world.run_for(Duration::from_secs(1));
        place.inputs(|inputs| assert_eq!(inputs[3], 7, "discrete inputs of the first slave"));
    });
}

/// Configures, goes to Op, and saves there; process data are exchanged meanwhile.
async fn save_in_op(bench: &Bench<'_>) {
    let group = bench.dispatcher.to_pre_op().await.unwrap();
    bench.configure(&group).await;
    let group: Group<_> = bench.to_op(group, &bench.output_image()).await;
    bench.cycle_for(&group, 500 * MS).await;
    let begin = Instant::now();
    let gateway = group.subdevice(bench.dispatcher.master, 0).unwrap();
    let ((), saved) = join(bench.cycle_for(&group, 2 * SLOW), async {
        gateway.sdo_write(0x1010, 1, SAVE).await.unwrap();
        begin.elapsed()
    })
    .await;
    assert!(
        saved >= SLOW && saved < SLOW + 50 * MS,
        "it is answered when it is saved: {} ms",
        saved.as_millis()
    );
    assert!(group.tx_rx(bench.dispatcher.master).await.unwrap().all_op(), "and Op was not left");
    assert_eq!(gateway.sdo_read::<u32>(0x1010, 1).await.unwrap(), 1, "on command");
}

#[test]
fn statement_56_what_cannot_be_saved_is_aborted() {
    with_devices(SETUP, async |bench| {
        let group = bench.dispatcher.to_pre_op().await.unwrap();
        let gateway = group.subdevice(bench.dispatcher.master, 0).unwrap();
        let nobody = gateway.sdo_write(0x1010, 1, SAVE).await;
        assert_eq!(abort_code(nobody), Some(0x0800_0020), "nobody has a store");
    });
    let store = SlowStore::failing(1);
    with_kept(SETTINGS, &store, async |dispatcher, _| {
        let group = dispatcher.to_pre_op().await.unwrap();
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        device.sdo_write(0x2005, 1, 1_u16).await.unwrap();
        let begin = Instant::now();
        let refused = device.sdo_write(0x1010, 1, SAVE).await;
        assert_eq!(abort_code(refused), Some(0x0800_0020));
        assert!(begin.elapsed() >= SLOW);
        assert_eq!(device.sdo_read::<[u8; 25]>(0x10f3, 6).await.unwrap()[6], 5, "and it is in the history");
        assert!(
            device
                .sdo_read::<[u8; 48]>(0x2006, 0)
                .await
                .unwrap()
                .starts_with(b"the settings could not be saved")
        );
    });
    assert_eq!(store.saved(), None);
}

#[test]
fn statement_56_a_save_of_before_a_restart_from_init_answers_no_other_sdo() {
    let store = SlowStore::failing(1);
    with_kept(SETTINGS, &store, async |dispatcher, _| {
        let group = dispatcher.to_pre_op().await.unwrap();
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        device.sdo_write(0x2005, 1, 1_u16).await.unwrap();
        let begin = Instant::now();
        let saved = select(device.sdo_write(0x1010, 1, SAVE), Timer::after(10 * MS)).await;
        assert!(matches!(saved, Either::Second(())), "the MainDevice does not wait for it");

        let group = dispatcher.to_pre_op().await.unwrap();
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        device.sdo_write(0x2001, 10, 1_000_u32).await.unwrap();
        assert!(begin.elapsed() < SLOW, "another SDO does not wait for it either");
        device.sdo_write(0x1010, 1, SAVE).await.unwrap();
        assert!(begin.elapsed() >= 2 * SLOW, "the outcome is its own: the first one failed");
    });
    assert!(store.saved().is_some());
}

#[test]
fn the_words_are_needed_and_a_configuration_in_use_to_save_and_none_to_restore() {
    let (_, mut objects) = objects();
    assert_eq!(write(&mut objects, 0x1010, 1, SAVE), Err(Abort::NotStored));
    assert_eq!(reason(&mut objects), "there is no place to save settings");
    with_gateway(1, SETTINGS, |world, rig| {
        let mut store = SlowStore::default();
        let gateway = rig.gateway;
        world.spawn(async move { gateway.keep_settings(&mut store).await });
        world.run_for(MS);
        let mut objects = GatewayObjects::new(rig.gateway.ethercat().unwrap());
        for index in [0x1010, 0x1011] {
            assert_eq!(write(&mut objects, index, 1, 1), Err(Abort::NotStored), "no word at all");
        }
        assert_eq!(write(&mut objects, 0x1010, 1, LOAD), Err(Abort::NotStored), "the other one's");
        assert_eq!(write(&mut objects, 0x1010, 1, SAVE), Err(Abort::State));
        assert_eq!(reason(&mut objects), "no configuration is in use");
        write(&mut objects, 0x2005, 1, 1).unwrap();
        assert_eq!(write(&mut objects, 0x1011, 1, LOAD), Err(Abort::State));
    });
}

#[test]
fn restored_defaults_hold_after_a_restart() {
    let store = SlowStore::default();
    let settings =
        format!("{SETTINGS}\nslave 0 unit 7 holding 9005 count 4 read 20ms check on-silence substitute 9");
    with_kept(&settings, &store, async |dispatcher, gateway| {
        assert!(gateway.ethercat().unwrap().is_running());
        let group = dispatcher.to_pre_op().await.unwrap();
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        for (index, sub, value) in [(0x2000, 1, 1), (0x2001, 1, 7), (0x2001, 8, 4), (0x2001, 9, 9_005)] {
            assert_eq!(device.sdo_read::<u16>(index, sub).await.unwrap(), value);
        }
        assert_eq!(device.sdo_read::<u8>(0x2007, 1).await.unwrap(), 1);
        assert_eq!(device.sdo_read::<u8>(0x2008, 1).await.unwrap(), 2);
        assert_eq!(device.sdo_read::<u16>(0x2009, 1).await.unwrap(), 9);
        device.sdo_write(0x2005, 2, 0_u16).await.unwrap();
        device.sdo_write(0x1011, 1, LOAD).await.unwrap();
        assert_eq!(device.sdo_read::<u16>(0x2000, 1).await.unwrap(), 4);
    });
    let text = store.saved().unwrap();
    assert!(!text.contains("slave") && text.contains("port ecat ethercat"), "{text}");
    with_gateway(1, &text, |_, rig| assert!(!rig.gateway.ethercat().unwrap().is_running()));
}

#[test]
fn a_configuration_that_was_taken_over_is_among_the_settings() {
    with_gateway(1, SETTINGS, |world, rig| {
        let place = rig.gateway.ethercat().unwrap();
        let mut objects = GatewayObjects::new(place);
        for (index, sub, value) in
            [(0x2000, 1, 2), (0x2002, 1, 9), (0x2101, 2, 20), (0x2101, 3, 100), (0x2101, 10, 250)]
        {
            write(&mut objects, index, sub, value).unwrap();
        }
        world.run_for(MS);
        rig.gateway.settings(|settings| assert!(settings.slaves.is_empty(), "it has not been taken over"));
        write(&mut objects, 0x2005, 1, 1).unwrap();
        world.run_for(MS);
        let store = SlowStore::default();
        let settings = rig.gateway.settings(Settings::clone);
        let mut line = LineBuffer::default();
        world.run_until(async { write_store(&settings, &mut store.clone(), &mut line).await.unwrap() });
        let text = store.saved().unwrap();
        assert!(text.ends_with("slave 0 unit 1\nslave 1 unit 9 coil 100 count 20 read 250ms\n"), "{text}");
    });
}

#[test]
fn slaves_that_are_typed_are_asked_at_once_and_stand_in_the_objects() {
    with_gateway(1, SETTINGS, |world, rig| {
        let place = rig.gateway.ethercat().unwrap();
        let mut objects = GatewayObjects::new(place);
        rig.console("slave 0 unit 7 holding 9005 count 4").unwrap();
        assert!(place.is_running());
        assert_eq!((read(&mut objects, 0x2000, 1), read(&mut objects, 0x2100, 8)), (1, 4));
        assert_eq!(layout(&mut objects, 0), [0, 0, 0, 0, 0, 7, 0, 0, 0, 7]);
        let refused = rig.console("slave 1 unit 8 holding 0 count 253").unwrap_err();
        assert_eq!(refused, "slave 1 ends past the 512 input bytes");
        assert_eq!(read(&mut objects, 0x2000, 1), 1, "it changed nothing");
        write(&mut objects, 0x2005, 2, 0).unwrap();
        rig.console("edit port bus timeout 500ms").unwrap();
        assert!(!place.is_running(), "other settings start nothing");
        rig.console("slave 0 unit 7 holding 9005 count 5").unwrap();
        assert!(place.is_running());
        rig.console("delete slaves").unwrap();
        assert!(!place.is_running());
        world.run_for(MS);
        assert_eq!(read(&mut objects, 0x2000, 1), 4);
    });
}

#[test]
fn slaves_wait_for_the_line_of_their_port() {
    let settings = format!("{SETTINGS}\nslave 0 unit 7 holding 9005 count 4")
        .replace("ecat ethercat", "ecat ethercat line late");
    with_gateway(1, &settings, |_, rig| {
        let place = rig.gateway.ethercat().unwrap();
        let mut objects = GatewayObjects::new(place);
        assert!(!place.is_running());
        assert_eq!(reason(&mut objects), "the ethercat port's line is no RTU client");
        rig.console("edit port ecat line bus").unwrap();
        assert!(place.is_running());
        assert_eq!(reason(&mut objects), "");
    });
}
