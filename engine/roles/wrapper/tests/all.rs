//! Integration tests of this crate as one program, since each program links the whole engine anew.

mod batched;
mod common;
mod conversations;
mod equality;
mod failed;
mod junk;
mod metrics;
mod offloaded;
mod rival;
mod scenes;
mod self_steering;
mod server;
mod taken;
