//! Feeds the watchdog as long as every task responds.

use embassy_time::Duration;
use mobgate::gateway::{Gateway, Status};

use crate::gateway::{LIVENESS, TaskName, gateway};
use crate::lights::Lights;
use crate::sockets::Network;
use crate::trial;

/// Time limit for the tasks' responses.
const PERIOD: Duration = Duration::from_millis(500);

/// Polls the tasks, calls `feed` while all respond, and shows it on the lights. Records the first silent task.
pub async fn watch(mut feed: impl FnMut(), lights: &mut impl Lights, network: Network) -> ! {
    let mut noted = false;
    loop {
        LIVENESS.ask();
        // Images without it are smaller, see Cargo.toml.
        #[cfg(feature = "ethercat")]
        let ethercat = crate::states::ETHERCAT.light_for(lights, PERIOD).await;
        #[cfg(not(feature = "ethercat"))]
        let ethercat = {
            embassy_time::Timer::after(PERIOD).await;
            false
        };
        let silent = LIVENESS.silent();
        trial::note_responses(silent.is_none());
        match silent {
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
