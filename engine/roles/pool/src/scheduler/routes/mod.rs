//! The routes of the scheduler: what a message, a result or time leads to in its parts.

mod agreement;
mod batched;
mod dispatch;
mod duplicates;
mod events;
mod failures;
mod offloaded;
mod requests;
mod results;
mod servers;
mod stepwise;
mod supervised;
mod work;
