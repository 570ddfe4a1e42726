//! SII.
