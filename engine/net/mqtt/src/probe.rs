//! What a broker does with small packets, determined on a separate connection.

use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

use crate::handshake::{self, Caller};
use crate::session::Session;
use crate::settings::Settings;
use crate::transport::Transport;

/// PINGREQ and PINGRESP, the smallest packets that a client can ask for and a broker answers by itself.
const QUESTION: [u8; 2] = [0xc0, 0];
const QUESTIONS: usize = 3;
/// Attempts: a busy machine may delay some answers, but hardly all.
const TRIES: usize = 4;
/// Systems acknowledge late after 40 ms or more. Answers that are further apart than this waited for that.
const HELD_BACK: Duration = Duration::from_millis(25);

/// Whether the broker holds small packets back until those before have been acknowledged (Nagle's algorithm). Connects,
/// asks several things at once and looks whether the answers come together; blocks for some 200 ms then.
///
/// On systems other than Linux a late acknowledgement cannot be requested, so that the result may be false although the broker does.
///
/// # Errors
/// No connection, or it broke.
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
    // The broker notices the end of the connection by itself if this does not reach it.
    Session::disconnect(&mut out);
    send(&mut transport, &out).unwrap_or_default();
    Ok(shortest >= HELD_BACK)
}

/// The time from the first to the last of the broker's answers to pings that were sent at once.
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
