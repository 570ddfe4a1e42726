//! The logging facade: `log` on hosts, `defmt` on boards, nothing without either feature.

macro_rules! logger {
    ($name:ident, $level:ident, $d:tt) => {
        macro_rules! $name {
                    ($d($arg:tt)*) => {{
                        // Which logger exists depends on what the board links, hence a feature.
                        #[cfg(feature = "log")]
                        ::log::$level!($d($arg)*);
                        #[cfg(all(feature = "defmt", not(feature = "log")))]
                        ::defmt::$level!("{}", ::defmt::Display2Format(&::core::format_args!($d($arg)*)));
                        #[cfg(not(any(feature = "defmt", feature = "log")))]
                        let _ = ::core::format_args!($d($arg)*);
                    }};
                }
    };
}

logger!(log_debug, debug, $);
logger!(log_info, info, $);
logger!(log_warn, warn, $);
