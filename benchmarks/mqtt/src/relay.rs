//! No broker: two TCP connections joined, byte for byte. What is left of a round trip is the operating system.

use crate::{Failure, options::Options};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;

/// Joins each two connections until the process is ended.
pub fn run(options: &Options) -> Result<String, Failure> {
    let listener = TcpListener::bind((options.host.as_str(), options.port))?;
    eprintln!("relay on {}", listener.local_addr()?);
    loop {
        let (first, _) = listener.accept()?;
        let (second, _) = listener.accept()?;
        for stream in [&first, &second] {
            stream.set_nodelay(true)?;
        }
        let (first_back, second_back) = (first.try_clone()?, second.try_clone()?);
        thread::spawn(move || copy(first, second));
        thread::spawn(move || copy(second_back, first_back));
    }
}

fn copy(mut from: TcpStream, mut to: TcpStream) {
    let mut bytes = vec![0; 1 << 16];
    while let Ok(read @ 1..) = from.read(&mut bytes) {
        if to.write_all(&bytes[..read]).is_err() {
            break;
        }
    }
}
