//! Integration tests of this crate as one program, since each program links the whole engine anew.

mod clients;
mod common;
mod lifecycle;
mod messages;
mod passwords;
mod security;
#[cfg(unix)]
mod unix;
mod websocket;
