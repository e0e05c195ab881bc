//! Integration tests of this crate as one program, since each program links the whole engine anew.

mod accounts;
mod common;
mod connection;
mod dialects;
mod mosquitto;
mod other_brokers;
#[cfg(unix)]
mod unix;
