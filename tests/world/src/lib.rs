//! Virtual time for tests: [`World`] polls futures in an order drawn from a seed, and leaps from alarm to alarm.
//!
//! What waits does so by embassy-time, whose driver here is `mobgate-clock`. [`Random`] are the numbers of a seed, the same on every
//! machine. With the feature `wall`, `wall_clock` runs a future beside file descriptors.
#![forbid(unsafe_code)]

pub mod random;
#[cfg(feature = "wall")] // It takes a crate for the system's calls.
pub mod wall_clock;
pub mod world;

pub use random::Random;
pub use world::{Task, World};
