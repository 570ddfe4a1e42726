//! Feeds the watchdog as long as every task answers.

use embassy_time::Duration;
use mobgate::gateway::{Gateway, Status};

use crate::gateway::{LIVENESS, TaskName, gateway};
use crate::network::Network;

/// Time limit for the tasks' answers.
const PERIOD: Duration = Duration::from_millis(500);

/// What the board's lights show.
pub trait Lights {
    /// Waits for `time`, showing the EtherCAT state meanwhile; returns whether there was any to show.
    async fn show_ethercat(&mut self, time: Duration) -> bool;

    /// Shows that every task answers, whether the network `has_address`, and whether a port `is_lost` or failed to open; what
    /// EtherCAT uses is left to it.
    fn show(&mut self, has_address: bool, is_lost: bool, ethercat: bool);
}

/// Polls the tasks, calls `feed` while all answer, and shows it on the lights. Records the first silent task.
pub async fn watch(mut feed: impl FnMut(), mut lights: impl Lights, network: Network) -> ! {
    let mut noted = false;
    loop {
        LIVENESS.ask();
        let ethercat = lights.show_ethercat(PERIOD).await;
        match LIVENESS.silent() {
            None => {
                feed();
                lights.show(network.stack().is_config_up(), is_lost(gateway()), ethercat);
            }
            Some(task) if !noted => {
                noted = true;
                mobgate_faults::note(format_args!("the {} stood still", TaskName(task)));
            }
            Some(_) => {}
        }
    }
}

fn is_lost(gateway: &Gateway<'_>) -> bool {
    gateway.ports().iter().any(|port| matches!(port.status(), Status::Lost | Status::Failed(_)))
}
