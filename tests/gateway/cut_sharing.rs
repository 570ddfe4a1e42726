//! Frames that are passed on while they arrive, beside reads that share answers: what is arriving shares nothing.
