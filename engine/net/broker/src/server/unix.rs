//! The file of a Unix socket: created for its owner alone, replaced if its broker has ended, and removed at the end.

use crate::BrokerError;
use socket2::{Domain, SockAddr, Socket, Type};
use std::fs::{self, File, Metadata, Permissions};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;
use swarmwright_sockets::LONGEST_PATH;

/// Largest number of connections that wait to be accepted; the system may allow fewer.
const BACKLOG: i32 = 4096;
/// Number of attempts to lock the folder, and the pause between them.
const TRIES: usize = 50;
const PAUSE: Duration = Duration::from_millis(20);

/// File of a socket on which this process listens; dropping it removes the file.
pub struct SocketFile {
    path: PathBuf,
    identity: (u64, u64),
}

impl SocketFile {
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for SocketFile {
    fn drop(&mut self) {
        // Another broker may have replaced the file.
        let is_same =
            fs::symlink_metadata(&self.path).is_ok_and(|file| identity(&file) == self.identity);
        if is_same && let Err(error) = fs::remove_file(&self.path) {
            log::warn!("{} could not be removed: {error}", self.path.display());
        }
    }
}

fn identity(file: &Metadata) -> (u64, u64) {
    (file.dev(), file.ino())
}

/// Listens at a path, replacing a stale file of an earlier broker.
pub fn listen(path: &Path, mode: u32) -> Result<(UnixListener, SocketFile), BrokerError> {
    let path = std::path::absolute(path).map_err(|error| refused(path, &error))?;
    let address = SockAddr::unix(&path).map_err(|_| wrong(&path, too_long(&path)))?;
    // If two brokers start at the same time, neither may remove the other's file before it listens.
    let lock = lock(path.parent().unwrap_or(&path));
    let socket =
        Socket::new(Domain::UNIX, Type::STREAM, None).map_err(|error| refused(&path, &error))?;
    match socket.bind(&address) {
        Err(error) if error.kind() == ErrorKind::AddrInUse => {
            remove_stale(&path)?;
            socket.bind(&address)
        }
        bound => bound,
    }
    .map_err(|error| refused(&path, &error))?;
    let metadata = fs::symlink_metadata(&path).map_err(|error| refused(&path, &error))?;
    let file = SocketFile {
        identity: identity(&metadata),
        path,
    };
    // No client can connect before the socket listens, whatever its mode.
    fs::set_permissions(&file.path, Permissions::from_mode(mode))
        .and_then(|()| socket.listen(BACKLOG))
        .map_err(|error| refused(&file.path, &error))?;
    drop(lock);
    Ok((socket.into(), file))
}

/// Locks the folder; `None` if this takes too long.
fn lock(folder: &Path) -> Option<File> {
    let folder = File::open(folder).ok()?;
    for _ in 0..TRIES {
        if folder.try_lock().is_ok() {
            return Some(folder);
        }
        thread::sleep(PAUSE);
    }
    None
}

/// Removes the socket of a broker that has ended.
fn remove_stale(path: &Path) -> Result<(), BrokerError> {
    let file = fs::symlink_metadata(path).map_err(|error| refused(path, &error))?;
    if !file.file_type().is_socket() {
        return Err(wrong(
            path,
            "is a file of another kind; remove it, or choose another path".to_owned(),
        ));
    }
    match UnixStream::connect(path) {
        Err(error) if error.kind() == ErrorKind::ConnectionRefused => {
            fs::remove_file(path).map_err(|error| refused(path, &error))
        }
        Err(error) if error.kind() == ErrorKind::PermissionDenied => Err(wrong(
            path,
            "belongs to another user, whose broker may be running; choose another path".to_owned(),
        )),
        _ => Err(BrokerError::SocketInUse { path: path.into() }),
    }
}

fn too_long(path: &Path) -> String {
    format!(
        "has {} bytes, more than this system allows for sockets ({LONGEST_PATH}); choose a shorter path",
        path.as_os_str().len()
    )
}

fn refused(path: &Path, error: &io::Error) -> BrokerError {
    let folder = path.parent().unwrap_or(path).display();
    wrong(
        path,
        match error.kind() {
            ErrorKind::NotFound => format!("the folder {folder} does not exist; create it"),
            ErrorKind::PermissionDenied => {
                format!("this user may not create files in {folder}; choose another folder")
            }
            _ => error.to_string(),
        },
    )
}

fn wrong(path: &Path, wrong: String) -> BrokerError {
    BrokerError::SocketPath {
        path: path.into(),
        wrong,
    }
}
