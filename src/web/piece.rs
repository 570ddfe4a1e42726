//! Pieces of a response, and what they are made of.

use heapless::String;
use heapless::string::StringView;

use crate::gateway::Gateway;
use crate::hal::System;

/// A piece. Most fit into a connection's own memory; a longer one is written in that of [`crate::gateway::web::Web::long_piece`].
pub(super) type Piece = StringView;
/// A connection's own memory for pieces.
pub(super) type ShortPiece = String<1_024>;

/// What responses are made of.
#[derive(Clone, Copy)]
pub(super) struct Source<'a, 'g> {
    pub(super) gateway: &'a Gateway<'g>,
    pub(super) system: &'a dyn System,
}
