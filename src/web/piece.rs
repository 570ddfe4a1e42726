//! Pieces of an answer, and what they are made of.

use heapless::String;

use crate::gateway::Gateway;
use crate::hal::System;

/// Fits the longest piece: the 2000 bits of a point.
pub(super) type Piece = String<6_144>;

/// What answers are made of.
#[derive(Clone, Copy)]
pub(super) struct Source<'a, 'g> {
    pub(super) gateway: &'a Gateway<'g>,
    pub(super) system: &'a dyn System,
}
