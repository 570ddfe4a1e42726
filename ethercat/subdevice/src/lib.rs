//! An EtherCAT SubDevice: everything between a controller chip (ESC) and the data of an application.
//!
//! The ESC takes part in the frames by itself; this code serves its other side, the process data interface: it reads
//! what the MainDevice wants from registers ([`esc`], over SPI by [`lan9252`]), and answers by registers and memory. [`sub_device`] does that, event by event:
//!
//! * a request for a state passes the state machine ([`al_state`]) and the checks of the SyncManagers ([`sync_manager`]);
//! * a message passes the mailbox ([`mailbox`]) and reaches its protocol by its number: CoE ([`coe`]), which serves the object
//!   dictionary ([`dictionary`]);
//! * process data ([`process`]) go to the application and come from it ([`application`]), PDO by PDO as they are assigned
//!   ([`assignment`]).
//!
//! What happened to it is told by the diagnosis history ([`diagnosis`]), and by emergencies. What the device is stands in one table ([`device`], [`object`], [`standard`]), from which the MainDevice's other sources are
//! made too: the controller's EEPROM ([`sii`]) and the description file ([`esi`]).
//!
//! | limit | value | why |
//! | --- | --- | --- |
//! | [`mailbox::MAILBOX_BYTES_MAX`] | 256 | a few messages are kept in memory |
//! | [`dictionary::OBJECT_BYTES_MAX`] | 520 | a buffer of 512 bytes, accessed completely |
//! | [`process::OUTPUTS_BYTES_MAX`], [`process::INPUTS_BYTES_MAX`] | 512, 584 | a controller of 4 KiB has 1280 bytes for both images, beside mailboxes of 128 |
//! | [`assignment::PDOS_ASSIGNED_MAX`] | 8 | a PDO for each kind of data |
#![no_std]
#![forbid(unsafe_code)]

pub mod al_state;
pub mod application;
pub mod assignment;
pub mod coe;
pub mod device;
pub mod diagnosis;
pub mod dictionary;
pub mod esc;
pub mod esi;
pub mod indicators;
pub mod lan9252;
pub mod mailbox;
pub mod object;
pub mod process;
pub mod registers;
pub mod sii;
pub mod standard;
pub mod sub_device;
pub mod sync_manager;
