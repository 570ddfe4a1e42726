//! Updates on a host: files that are refused, and power cuts at each operation of an update, of the swap and of the way back.

use mobgate_clock as _;

mod board;
mod flash;
mod power_cuts;
mod refused;
