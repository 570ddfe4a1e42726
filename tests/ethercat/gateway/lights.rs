//! The RUN and ERR lights, as the console and the lamps of a board show them.

use ethercat_subdevice::indicators::{Lamps, Pattern};
use mobgate_simulator::console::typed;

use super::objects::SETTINGS;
use crate::prelude::*;

/// Each change of the lamps: milliseconds, RUN, ERR.
#[derive(Clone, Default)]
struct Seen(Rc<RefCell<Vec<(u64, bool, bool)>>>);

impl Lamps for Seen {
    fn shine(&mut self, run: bool, error: bool) {
        self.0.borrow_mut().push((Instant::now().as_millis(), run, error));
    }
}

#[test]
fn statement_61_the_lights_show_each_state_and_why_it_was_left() {
    let objects = gateway_objects();
    let place = objects.shared();
    let mut rig = Rig::with_application(&GATEWAY, objects);
    assert_eq!(place.lights(), (Pattern::Off, Pattern::Off));
    rig.bring_to(PRE_OP);
    assert_eq!(place.lights(), (Pattern::Blinking, Pattern::Off));
    rig.request(SAFE_OP);
    assert_eq!(place.lights(), (Pattern::Blinking, Pattern::Blinking), "a wrong configuration");
    rig.request(INIT);
    assert_eq!(place.lights(), (Pattern::Off, Pattern::Off));
    rig.bring_to(SAFE_OP);
    assert_eq!(place.lights(), (Pattern::SingleFlash, Pattern::Off));
    rig.cycle(0);
    rig.request(OP);
    assert_eq!(place.lights(), (Pattern::On, Pattern::Off));
    rig.pass(200);
    assert_eq!(place.lights(), (Pattern::SingleFlash, Pattern::DoubleFlash), "the watchdog");
    rig.request(SAFE_OP | ERROR);
    assert_eq!(place.lights(), (Pattern::SingleFlash, Pattern::Off));
    // The MainDevice switches the inputs off.
    rig.write(0x0818 + 6, &[0]);
    assert_eq!(place.lights(), (Pattern::Blinking, Pattern::SingleFlash), "by its own decision");
}

#[test]
fn statement_61_lamps_that_have_other_uses_are_left_to_them_until_there_is_a_controller_or_a_port() {
    // For the second time the port is there, and nobody serves a controller.
    for (settings, has_port) in [("", false), (SETTINGS, true)] {
        with_gateway(1, settings, |world, rig| {
            let place = rig.gateway.ethercat().unwrap();
            let seen = Seen::default();
            let mut lamps = seen.clone();
            let half_a_second = Duration::from_millis(500);
            assert_eq!(world.run_until(place.light_for(&mut lamps, half_a_second)), has_port);
            assert_eq!(seen.0.borrow().is_empty(), !has_port);
            let line = line_of(&GATEWAY);
            let (esc, interrupt) = direct(line.borrow().chip(0));
            spawn(world, SubDevice::new(&GATEWAY, esc, GatewayObjects::new(place)), interrupt);
            with_master(world, cable(line), async |dispatcher| {
                dispatcher.to_pre_op().await.unwrap();
            });
            seen.0.borrow_mut().clear();
            let begin = Instant::now();
            assert!(world.run_until(place.light_for(&mut lamps, half_a_second)));
            assert_eq!(begin.elapsed(), half_a_second);
            let blinks = seen.0.borrow().iter().filter(|(_, run, error)| *run && !error).count() >= 1;
            assert!(blinks, "RUN blinks");
        });
    }
}

#[test]
fn statement_61_lamps_follow_in_the_times_of_etg_1300_and_the_console_says_the_same() {
    with_gateway(1, SETTINGS, |world, rig| {
        let place = rig.gateway.ethercat().unwrap();
        let seen = Seen::default();
        let mut lamps = seen.clone();
        let line = line_of(&GATEWAY);
        let (esc, interrupt) = direct(line.borrow().chip(0));
        spawn(world, SubDevice::new(&GATEWAY, esc, GatewayObjects::new(place)), interrupt);
        world.spawn(async move { place.light(&mut lamps).await });
        with_master(world, cable(line), async |dispatcher| {
            dispatcher.to_pre_op().await.unwrap();
        });
        let shown = world.run_until(async { typed(rig.gateway, "show version\n").await });
        assert!(shown.contains("EtherCAT controller present, PreOp, RUN blinking, ERR off"), "{shown}");
        // The first change is somewhere within a phase.
        world.run_for(Duration::from_millis(200));
        seen.0.borrow_mut().clear();
        world.run_for(Duration::from_secs(2));
        let changes = seen.0.borrow().clone();
        assert_eq!(changes.len(), 10, "{changes:?}");
        let is_even = changes.is_sorted() && changes.windows(2).all(|two| two[1].0 - two[0].0 == 200);
        assert!(is_even, "{changes:?}");
        assert!(changes.windows(2).all(|two| two[0].1 != two[1].1) && changes.iter().all(|change| !change.2));
    });
}
