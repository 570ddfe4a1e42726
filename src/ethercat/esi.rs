//! ESI.
