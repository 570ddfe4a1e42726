//! Feeds the watchdog as long as every task answers.

use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::Duration;

use crate::gateway::{LIVENESS, TaskName, gateway};
use crate::lights::Lights;
use crate::sockets::Network;

/// Reset after this time without feeding. Erasing a sector of an F7 takes 2 s (4 s at worst), and everything stalls meanwhile. The
/// watchdog has its own oscillator, which may run a third fast.
pub(crate) const TIMEOUT_US: u32 = 10_000_000;
/// Time limit for the tasks' answers.
const PERIOD: Duration = Duration::from_millis(500);

/// Feeds the watchdog before an operation that stalls the chip; has no effect before the watchdog is started.
#[cfg(feature = "f7")]
pub(crate) fn feed() {
    use embassy_stm32::pac::{IWDG, iwdg::vals::Key};
    IWDG.kr().write(|command| command.set_key(Key::RESET));
}

/// Polls the tasks, feeds the running watchdog while all answer, and shows it on the lights. Records the first silent task.
pub(crate) async fn watch<T: embassy_stm32::wdg::Instance>(
    mut watchdog: IndependentWatchdog<'static, T>,
    mut lights: Lights,
    network: Network,
) -> ! {
    let mut noted = false;
    loop {
        LIVENESS.ask();
        let ethercat = lights.show_ethercat(PERIOD).await;
        match LIVENESS.silent() {
            None => {
                watchdog.pet();
                lights.show(gateway(), network.stack().is_config_up(), ethercat);
            }
            Some(task) if !noted => {
                noted = true;
                mobgate_faults::note(format_args!("the {} stood still", TaskName(task)));
            }
            Some(_) => {}
        }
    }
}
