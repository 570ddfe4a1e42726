//! The EtherCAT SubDevice: everything between a controller chip (ESC) and an application's data, without a word of Modbus.
//!
//! The ESC takes part in the frames by itself; this code serves its other side, the process data interface: it reads
//! what the MainDevice wants from registers ([`esc`]), and answers by registers and memory.

pub mod esc;
pub mod lan9252;
