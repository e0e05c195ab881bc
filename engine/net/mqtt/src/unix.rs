//! Connection to a broker's Unix socket.

use std::io::{self, ErrorKind};
use std::os::unix::fs::FileTypeExt;
use std::path::Path;

use mio::net::UnixStream;
use socket2::{Domain, SockAddr, Type};
use swarmwright_sockets::Socket;

use crate::ConnectError;
use crate::settings::Settings;

/// Returns a connected Unix socket, which blocks, with the settings' time-out.
pub fn connect(settings: &Settings) -> Result<Socket, ConnectError> {
    let url = settings.url.to_string();
    open(settings).map_err(|error| {
        let path = Path::new(&settings.url.path);
        let reason = match error.kind() {
            ErrorKind::PermissionDenied => {
                return ConnectError::Forbidden { url };
            }
            ErrorKind::NotFound => "the file does not exist".to_owned(),
            ErrorKind::ConnectionRefused
                if path
                    .metadata()
                    .is_ok_and(|file| !file.file_type().is_socket()) =>
            {
                "the file is not a socket".to_owned()
            }
            ErrorKind::ConnectionRefused => {
                "no process listens at this socket; the one that created it has ended".to_owned()
            }
            // Linux reports this if the queue of unaccepted connections has been full for too long.
            ErrorKind::WouldBlock => "it did not accept the connection in time".to_owned(),
            _ => error.to_string(),
        };
        ConnectError::NoBroker { url, reason }
    })
}

fn open(settings: &Settings) -> io::Result<Socket> {
    let address = SockAddr::unix(&settings.url.path)?;
    let socket = socket2::Socket::new(Domain::UNIX, Type::STREAM, None)?;
    // Set before connecting, since the write time-out also applies to that.
    socket.set_write_timeout(Some(settings.timeout))?;
    socket.set_read_timeout(Some(settings.timeout))?;
    socket.connect(&address)?;
    Ok(Socket::Unix(UnixStream::from_std(socket.into())))
}
