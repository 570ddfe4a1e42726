//! Everything to describe and run a device: `use ethercat_subdevice::prelude::*`.

pub use crate::al_state::{AlState, AlStatusCode};
pub use crate::application::{Address, Application};
pub use crate::coe::abort::Abort;
pub use crate::device::{Device, Identity};
pub use crate::eoe::{Eoe, Ethernet, EthernetError, FRAME_BYTES_MAX, IpSettings, Link};
pub use crate::esc::{Esc, EscError};
pub use crate::foe::{FileAccess, FileError, FileErrorCode, Files, Opening, Transfer};
pub use crate::object::{Access, DataType, Entry, Mapped, Object};
pub use crate::standard;
pub use crate::sub_device::SubDevice;
pub use crate::sync_manager::{Channel, MemoryPlan};
