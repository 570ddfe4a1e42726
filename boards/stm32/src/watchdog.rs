//! The watchdog is fed as long as every task answers.

use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::Duration;

use crate::gateway::{LIVENESS, TaskName, gateway};
use crate::lights::Lights;
use crate::sockets::Network;

/// The chip starts again when it was not fed for so long. Erasing a sector of an F7 takes 2 s (4 s at worst), and everything
/// stands still meanwhile. The chip's own oscillator counts, which may be a third faster than it says.
pub(crate) const TIMEOUT_US: u32 = 10_000_000;
/// Tasks have so long to answer.
const PERIOD: Duration = Duration::from_millis(500);

/// Feeds the watchdog before something for which the chip stands still; one that does not run yet takes no notice.
#[cfg(feature = "f7")]
pub(crate) fn feed() {
    use embassy_stm32::pac::{IWDG, iwdg::vals::Key};
    IWDG.kr().write(|command| command.set_key(Key::RESET));
}

/// Asks the tasks, feeds the watchdog, which runs, while all answer, and shows it. The first silent task is written down.
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
