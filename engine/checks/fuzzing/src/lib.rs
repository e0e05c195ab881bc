//! What the fuzz tests of the decoders share: payloads made from golden ones and from nothing, how many of them, and how
//! much memory a decoder takes for one.
//!
//! `PROPTEST_CASES` says how many inputs each test gets; `make fuzz` sets it.

mod memory;
mod mutation;
mod packets;

use proptest::test_runner::Config;

pub use memory::{Counting, held, peak};
pub use mutation::{mutated, noise};
pub use packets::{packets_of_brokers, packets_of_clients};

/// Inputs of each test by default: some seconds for all decoders together.
const FEW: u32 = 2_000;

/// How a fuzz test runs.
#[must_use]
pub fn config() -> Config {
    let cases = std::env::var("PROPTEST_CASES").ok();
    Config {
        cases: cases.and_then(|text| text.parse().ok()).unwrap_or(FEW),
        max_shrink_iters: 100_000,
        // What was found becomes a golden vector or a test of its own.
        failure_persistence: None,
        ..Config::default()
    }
}
