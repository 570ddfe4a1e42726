//! An EtherCAT SubDevice stack: everything between a controller chip (ESC) and the application's data.
//!
//! The ESC processes frames on its own; this code serves its other side, the process data interface: it reads the MainDevice's
//! requests from registers ([`esc`], over SPI by [`lan9252`]), and responds through registers and memory. [`sub_device`] does that,
//! event by event:
//!
//! * a state request passes the state machine ([`al_state`]) and the checks of the SyncManagers ([`sync_manager`]);
//! * a message passes the mailbox ([`mailbox`]), which dispatches by protocol: CoE ([`coe`]) serves the object dictionary
//!   ([`dictionary`]), FoE ([`foe`]) the application's files, EoE ([`eoe`]) its Ethernet frames;
//! * process data ([`process`]) are exchanged with the application ([`application`]), PDO by PDO as assigned
//!   ([`assignment`], [`communication`]): in free run, with the frames, or by distributed clocks ([`clocks`]).
//!
//! A device consists of a table, values, and a task:
//!
//! ```
//! use embedded_hal_async::digital::Wait;
//! use ethercat_subdevice::prelude::*;
//!
//! const IDENTITY: Identity = Identity { vendor: 0xe000_0000, product: 1, revision: 1, serial: 0 };
//! static DEVICE: Device = Device {
//!     identity: IDENTITY,
//!     vendor_name: "Example",
//!     name: "Thermometer",
//!     order: "T-1",
//!     group: "Sensors",
//!     memory: MemoryPlan::new(128, 0, 2, 4096),
//!     controller: [0x80, 0, 0, 0, 0, 0, 0, 0],
//!     emergencies: false,
//!     files: FileAccess::None,
//!     ethernet: false,
//!     texts: &[],
//!     objects: &[
//!         standard::device_type(0),
//!         standard::identity(&standard::identity_entries(IDENTITY)),
//!         Object::mapping(0x1a00, "Inputs", &[Mapped { index: 0x6000, sub: 0, count: 1, bits: 16 }]),
//!         standard::SYNC_MANAGER_TYPES,
//!         standard::tx_assignment(&[0x1a00], standard::FIXED),
//!         Object::variable(0x6000, Entry::input("Temperature", DataType::U16)),
//!     ],
//! };
//!
//! struct Thermometer(u16);
//!
//! impl Application for Thermometer {
//!     fn read(&mut self, _at: Address, into: &mut [u8]) -> Result<usize, Abort> {
//!         into.copy_from_slice(&self.0.to_le_bytes());
//!         Ok(into.len())
//!     }
//!     fn write(&mut self, _at: Address, _value: &[u8]) {}
//!     fn outputs(&mut self, _pdo: u16, _bytes: &[u8]) {}
//!     fn inputs(&mut self, _pdo: u16, into: &mut [u8]) {
//!         into.copy_from_slice(&self.0.to_le_bytes());
//!     }
//!     fn outputs_stopped(&mut self) {}
//! }
//!
//! /// The task: with a LAN9252, `esc` is a `lan9252::Lan9252`.
//! async fn ethercat(esc: impl Esc, mut interrupt: impl Wait) -> ! {
//!     let mut sub_device = SubDevice::new(&DEVICE, esc, Thermometer(0));
//!     sub_device.run(async || interrupt.wait_for_high().await.expect("a pin")).await
//! }
//! #
//! # // The table makes a valid EEPROM as well.
//! # use ethercat_description::sii;
//! # sii::write(&DEVICE, &mut [0; sii::SII_BYTES]).unwrap();
//! ```
//!
//! The example `digital_io` runs a device on an emulated controller. The diagnosis history ([`diagnosis`]) and emergencies report a
//! device's errors. One table describes the device ([`device`], [`object`], [`standard`]); from it the crate `ethercat-description`
//! also generates the MainDevice's other sources: the controller's EEPROM (SII) and the description file (ESI).
//!
//! | limit | value | why |
//! | --- | --- | --- |
//! | [`mailbox::MAILBOX_BYTES_MAX`] | 128 | a few messages are kept in memory |
//! | [`dictionary::OBJECT_BYTES_MAX`] | 520 | a buffer of 512 bytes, accessed completely |
//! | [`process::OUTPUTS_BYTES`], [`process::INPUTS_BYTES`] | 512, 584, or as a [`sub_device::SubDevice`] is made | a controller of 4 KiB has 1280 bytes for both images, beside mailboxes of 128 |
//! | [`object::PDOS_SELECTED_MAX`], [`object::PDOS_ASSIGNED_MAX`] | 8, 33 | PDOs that a MainDevice assigns: one for each kind of data; those of modules: one for each |
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)] // For unit tests with frames of any length.
extern crate std;

pub mod al_state;
pub mod application;
pub mod assignment;
pub mod catalogue;
pub mod clocks;
pub mod coe;
pub mod communication;
pub mod device;
pub mod diagnosis;
pub mod dictionary;
pub mod eoe;
pub mod esc;
pub mod foe;
pub mod indicators;
pub mod lan9252;
pub mod mailbox;
pub mod object;
pub mod prelude;
pub mod process;
pub mod registers;
pub mod standard;
pub mod sub_device;
pub mod sync_manager;
