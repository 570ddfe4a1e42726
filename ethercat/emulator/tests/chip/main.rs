//! The controller at register level and the LAN9252 in front of it: what ETG.1000 and the data sheets say of them.

mod buffers;
mod commands;
mod control;
mod eeprom;
mod fmmu;
mod lan9252;
mod line;
mod mailbox;
mod registers;
