//! What the tests of the Linux program know of their peers, for those that are shared with them.

pub(crate) use mobgate_qemu::PATIENCE;
