//! The RUN and ERR indicators (ETG.1300): the pattern of each state, its timing, and LEDs that follow it.
//!
//! The patterns are functions of state and time only, so both indicators of a device, and all LEDs that follow them, stay in phase.

use core::fmt::{self, Display};

use embassy_time::{Duration, Instant, Timer};

use crate::al_state::{AlMachine, AlState, AlStatusCode};

/// The shortest on or off time: that of flickering.
pub const FLICKER: Duration = Duration::from_millis(50);
/// On time of all other patterns.
const FLASH: Duration = Duration::from_millis(200);
/// Pause between flashes, or pairs of flashes.
const GAP: Duration = Duration::from_millis(1_000);

/// A light pattern.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pattern {
    /// Permanently off.
    #[default]
    Off,
    /// Permanently on.
    On,
    /// 200 ms on, 200 ms off.
    Blinking,
    /// 200 ms on, a second off.
    SingleFlash,
    /// Two flashes of 200 ms, a second off.
    DoubleFlash,
    /// 50 ms on, 50 ms off.
    Flickering,
}

impl Pattern {
    /// Whether the light is on, `since` the start of the pattern.
    pub fn is_lit(self, since: Duration) -> bool {
        let (flashes, each, gap) = match self {
            Self::Off => return false,
            Self::On => return true,
            Self::Blinking => (1, FLASH, FLASH),
            Self::SingleFlash => (1, FLASH, GAP),
            Self::DoubleFlash => (2, FLASH, GAP),
            Self::Flickering => (1, FLICKER, FLICKER),
        };
        let lit = (2 * flashes - 1) * each.as_ticks();
        let place = since.as_ticks() % (lit + gap.as_ticks());
        place < lit && (place / each.as_ticks()).is_multiple_of(2)
    }
}

impl Display for Pattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Off => "off",
            Self::On => "on",
            Self::Blinking => "blinking",
            Self::SingleFlash => "single flash",
            Self::DoubleFlash => "double flash",
            Self::Flickering => "flickering",
        })
    }
}

/// What a SubDevice indicates: its state and error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Indicators {
    /// The current state.
    pub state: AlState,
    /// The error that has not been acknowledged.
    pub fault: Option<AlStatusCode>,
    /// Whether the device entered that state by itself.
    pub fell: bool,
}

impl AlMachine {
    /// What the device's lights show.
    pub const fn indicators(&self) -> Indicators {
        Indicators { state: self.state(), fault: self.fault(), fell: self.fell }
    }
}

impl Indicators {
    /// The RUN light (green).
    pub const fn run(&self) -> Pattern {
        match self.state {
            AlState::Init => Pattern::Off,
            AlState::PreOp => Pattern::Blinking,
            AlState::SafeOp => Pattern::SingleFlash,
            AlState::Op => Pattern::On,
            AlState::Boot => Pattern::Flickering,
        }
    }

    /// The ERR light (red).
    pub const fn error(&self) -> Pattern {
        match (self.fault, self.fell) {
            (None, _) => Pattern::Off,
            (Some(AlStatusCode::SyncManagerWatchdog), true) => Pattern::DoubleFlash,
            // A local error; a refused request is a configuration error.
            (Some(_), true) => Pattern::SingleFlash,
            (Some(_), false) => Pattern::Blinking,
        }
    }
}

/// `PreOp, RUN blinking, ERR off`
impl Display for Indicators {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = match self.state {
            AlState::Init => "Init",
            AlState::PreOp => "PreOp",
            AlState::Boot => "Boot",
            AlState::SafeOp => "SafeOp",
            AlState::Op => "Op",
        };
        write!(f, "{state}, RUN {}, ERR {}", self.run(), self.error())?;
        self.fault.map_or(Ok(()), |code| write!(f, " ({:04X}h)", code as u16))
    }
}

/// The two LEDs of a device.
pub trait Lamps {
    /// Switches the LEDs. Called when one of them changes.
    fn shine(&mut self, run: bool, error: bool);
}

/// Drives `lamps` forever by `patterns`, which returns the RUN and the ERR pattern.
pub async fn show(lamps: &mut impl Lamps, mut patterns: impl FnMut() -> (Pattern, Pattern)) -> ! {
    let mut shown = None;
    loop {
        let since = Duration::from_ticks(Instant::now().as_ticks());
        let (run, error) = patterns();
        let lit = (run.is_lit(since), error.is_lit(since));
        if shown != Some(lit) {
            lamps.shine(lit.0, lit.1);
            shown = Some(lit);
        }
        // All times are multiples of the shortest one.
        Timer::at(Instant::from_ticks(since.as_ticks() / FLICKER.as_ticks() * FLICKER.as_ticks()) + FLICKER)
            .await;
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;
    use std::vec;
    use std::vec::Vec;

    use embassy_time::Duration;

    use super::{Indicators, Pattern};
    use crate::al_state::{AlState, AlStatusCode};

    /// Where a pattern changes in its first `millis`, beginning with what it is at 0.
    fn changes(pattern: Pattern, millis: u64) -> (bool, Vec<u64>) {
        let lit = |at| pattern.is_lit(Duration::from_millis(at));
        (lit(0), (1..millis).filter(|at| lit(*at) != lit(at - 1)).collect())
    }

    #[test]
    fn each_pattern_has_its_times() {
        assert_eq!(changes(Pattern::Off, 3_000), (false, vec![]));
        assert_eq!(changes(Pattern::On, 3_000), (true, vec![]));
        assert_eq!(changes(Pattern::Blinking, 1_000), (true, vec![200, 400, 600, 800]));
        assert_eq!(changes(Pattern::SingleFlash, 2_500), (true, vec![200, 1_200, 1_400, 2_400]));
        assert_eq!(
            changes(Pattern::DoubleFlash, 2_500),
            (true, vec![200, 400, 600, 1_600, 1_800, 2_000, 2_200])
        );
        assert_eq!(changes(Pattern::Flickering, 210), (true, vec![50, 100, 150, 200]));
    }

    #[test]
    fn the_lights_show_the_state_and_whose_fault_it_is() {
        let shown = |state, fault, fell| Indicators { state, fault, fell }.to_string();
        let watchdog = Some(AlStatusCode::SyncManagerWatchdog);
        assert_eq!(shown(AlState::Init, None, false), "Init, RUN off, ERR off");
        assert_eq!(shown(AlState::PreOp, None, false), "PreOp, RUN blinking, ERR off");
        assert_eq!(shown(AlState::Boot, None, false), "Boot, RUN flickering, ERR off");
        assert_eq!(shown(AlState::Op, None, false), "Op, RUN on, ERR off");
        assert_eq!(
            shown(AlState::SafeOp, watchdog, true),
            "SafeOp, RUN single flash, ERR double flash (001Bh)"
        );
        assert_eq!(shown(AlState::SafeOp, watchdog, false), "SafeOp, RUN single flash, ERR blinking (001Bh)");
        let local = Some(AlStatusCode::RestartedLocally);
        assert_eq!(shown(AlState::Init, local, true), "Init, RUN off, ERR single flash (0060h)");
    }
}
