//! Pieces of a response, and what they are made of.

use heapless::String;
use heapless::string::StringView;

use crate::gateway::Gateway;
use crate::hal::System;

/// A piece. Most fit into a connection's own memory; a longer one is written in that of [`crate::gateway::web::Web::long_piece`].
pub(super) type Piece = StringView;
/// Bytes of a connection's own memory for pieces.
pub(super) const SHORT_BYTES: usize = if cfg!(feature = "long-requests") { 1_024 } else { 512 };
pub(super) type ShortPiece = String<SHORT_BYTES>;

/// Bytes of the longest response that is made before it is sent.
pub(super) const TEXT_BYTES_MAX: usize = if cfg!(feature = "long-requests") { 2_048 } else { 768 };
pub(super) type Text = String<TEXT_BYTES_MAX>;

/// What responses are made of.
#[derive(Clone, Copy)]
pub(super) struct Source<'a, 'g> {
    pub(super) gateway: &'a Gateway<'g>,
    pub(super) system: &'a dyn System,
}
