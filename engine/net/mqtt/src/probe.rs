//! Probe of how a broker handles small packets, on a separate connection.

use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

use crate::handshake::{self, Caller};
use crate::session::Session;
use crate::settings::Settings;
use crate::transport::Transport;

/// PINGREQ, the smallest packet that a broker answers on its own; PINGRESP has the same size.
const QUESTION: [u8; 2] = [0xc0, 0];
const QUESTIONS: usize = 3;
/// Number of attempts; a busy machine may delay some answers, but hardly all.
const TRIES: usize = 4;
/// Time between answers above which they waited for an acknowledgement; systems delay acknowledgements by 40 ms or
/// more.
const HELD_BACK: Duration = Duration::from_millis(25);

/// Returns whether the broker holds small packets back until earlier ones have been acknowledged (Nagle's algorithm).
/// Connects, sends several pings at once, and checks whether the answers arrive together; if not, this blocks for some
/// 200 ms.
///
/// Delayed acknowledgements can only be requested on Linux, so on other systems the result may be false although the
/// broker holds packets back.
///
/// # Errors
/// Fails if the connection cannot be established, or breaks.
pub fn holds_back_small_packets(settings: &Settings) -> io::Result<bool> {
    let settings = Settings {
        will: None,
        ..settings.clone()
    };
    let client_id = format!("swarmwright-{:016x}", fastrand::u64(..));
    let caller = Caller {
        settings: &settings,
        client_id: &client_id,
        subscriptions: &[],
        waits: false,
    };
    let (mut chunk, mut out) = (vec![0; 4096], Vec::new());
    let (mut transport, _) = handshake::connect(&caller, &mut chunk, &mut out, &mut Vec::new())
        .map_err(io::Error::other)?;
    transport.set_read_timeout(settings.timeout)?;
    let mut shortest = Duration::MAX;
    for _ in 0..TRIES {
        shortest = shortest.min(spread(&mut transport, &mut chunk)?);
        if shortest < HELD_BACK {
            break;
        }
    }
    // If this does not reach the broker, it notices the end of the connection itself.
    Session::disconnect(&mut out);
    send(&mut transport, &out).unwrap_or_default();
    Ok(shortest >= HELD_BACK)
}

/// Returns the time between the first and the last answer to pings that were sent at once.
fn spread(transport: &mut Transport, chunk: &mut [u8]) -> io::Result<Duration> {
    transport.acknowledge_late();
    send(transport, &QUESTION.repeat(QUESTIONS))?;
    let mut missing = QUESTIONS * QUESTION.len();
    let mut first = None;
    loop {
        let count = transport.read(chunk)?;
        let now = Instant::now();
        if count == 0 {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        let first = *first.get_or_insert(now);
        missing = missing.saturating_sub(count);
        if missing == 0 {
            return Ok(now.duration_since(first));
        }
    }
}

fn send(transport: &mut Transport, mut bytes: &[u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        let count = transport.write(bytes)?;
        bytes = &bytes[count..];
    }
    transport.flush()
}
