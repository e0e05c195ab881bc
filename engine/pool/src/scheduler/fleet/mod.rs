//! Servers: which there are, what each offers, how they behave, how much they can do.

pub(crate) mod capacity;
pub(crate) mod discovery;
pub(crate) mod health;
pub(crate) mod lag;
pub(crate) mod offers;
pub(crate) mod pace;
pub(crate) mod slot;
