//! Frames that are passed on while they arrive, from one serial line to another.
//!
//! [`timing`] says when the copy of a frame may begin; `ingress` hears the request, `egress` sends what is there, `response`
//! takes the response the same way back.

pub(crate) mod egress;
pub(crate) mod ingress;
pub(crate) mod response;
pub mod timing;
