//! Round trips: one message there, one back, nothing else under way.

use crate::{Failure, connection::Connection, options::Options, packet};
use std::thread;
use std::time::{Duration, Instant};

/// Plays `count` round trips and describes their times in microseconds as a JSON object.
pub fn run(options: &Options) -> Result<String, Failure> {
    let mut far = Connection::open(options, "far", Some(&options.topic))?;
    let mut near = Connection::open(options, "near", Some(&options.back))?;
    let warm_up = options.count / 20 + 1;
    let rounds = options.count + warm_up;
    let there = packet::publish(&options.topic, &options.payload, options.five);
    let answer = vec![b'x'; options.bytes_back];
    let back = packet::publish(&options.back, &answer, options.five);
    let echo = thread::spawn(move || -> Result<(), String> {
        for _ in 0..rounds {
            far.await_publish().map_err(|error| error.to_string())?;
            far.write(&back).map_err(|error| error.to_string())?;
        }
        Ok(())
    });
    let mut times = Vec::new();
    for round in 0..rounds {
        let start = Instant::now();
        near.write(&there)?;
        near.await_publish()?;
        if round >= warm_up {
            times.push(start.elapsed());
        }
    }
    echo.join().map_err(|_| "the echoing thread failed")??;
    times.sort_unstable();
    let us = |time: Duration| time.as_secs_f64() * 1e6;
    let at = |share: f64| us(times[((times.len() - 1) as f64 * share) as usize]);
    let mean = us(times.iter().sum::<Duration>()) / times.len() as f64;
    Ok(format!(
        r#"{{"test":"pingpong","bytes":{},"count":{},"mean_us":{mean:.2},"median_us":{:.2},"p99_us":{:.2},"min_us":{:.2}}}"#,
        options.payload.len(),
        options.count,
        at(0.5),
        at(0.99),
        at(0.0),
    ))
}
