//! Cut-through: frames forwarded from one serial line to another while they are still arriving.
//!
//! [`timing`] computes when forwarding may begin; `ingress` fills the frame at the receiving line, `egress` sends it at the
//! other, and `response` forwards the response in the opposite direction.

pub(crate) mod egress;
pub(crate) mod ingress;
pub(crate) mod response;
pub mod timing;
