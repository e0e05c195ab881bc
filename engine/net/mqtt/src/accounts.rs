//! Accounts of brokers that run on this machine for this user, so that the user's other programs can log in.
//!
//! The broker's program publishes its account: for this process in memory, and for others in a file that only the user
//! can read, `~/.local/state/swarmwright/brokers/HOST/ADDRESS-PORT.env`. The program holds a lock on the file while it
//! runs; files without a lock are stale and ignored.

use crate::settings::{BrokerUrl, Scheme};
use std::collections::HashMap;
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Read, Write};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use std::{env, process, thread};

/// User name and password.
pub type UserAndPassword = (String, String);

/// Largest number of bytes to read; the file of an account has a few lines.
const LARGEST_FILE: u64 = 1 << 16;
/// Number of attempts to lock the folder, and the pause between them.
const TRIES: usize = 50;
const PAUSE: Duration = Duration::from_millis(20);

static OF_THIS_PROCESS: Mutex<Option<HashMap<SocketAddr, UserAndPassword>>> = Mutex::new(None);

fn of_this_process() -> MutexGuard<'static, Option<HashMap<SocketAddr, UserAndPassword>>> {
    OF_THIS_PROCESS
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
}

/// A published account that clients of this user find; dropping it withdraws the account.
pub struct Published {
    addresses: Vec<SocketAddr>,
    files: Vec<(PathBuf, File)>,
}

impl Published {
    /// Publishes the account of a broker that listens at these addresses of this machine, within this process only.
    #[must_use]
    pub fn in_memory(addresses: Vec<SocketAddr>, account: &UserAndPassword) -> Self {
        let mut accounts = of_this_process();
        let accounts = accounts.get_or_insert_default();
        for &address in &addresses {
            accounts.insert(address, account.clone());
        }
        Self {
            addresses,
            files: Vec::new(),
        }
    }

    /// Publishes the account to other programs of the user as well.
    ///
    /// # Errors
    /// Fails if the user has no folder for it, or if the file cannot be written.
    pub fn write(&mut self, (user, password): &UserAndPassword) -> io::Result<()> {
        let folder = folder().ok_or_else(|| {
            io::Error::other("neither XDG_STATE_HOME nor HOME names a folder of this user")
        })?;
        create_private(&folder)?;
        // If two programs start at the same time, neither may remove the other's file.
        let _lock = lock(&folder);
        remove_stale(&folder);
        for &address in &self.addresses {
            let text = format!(
                "export SWARMWRIGHT_USERNAME={user}\nexport SWARMWRIGHT_PASSWORD={password}\n"
            );
            let path = folder.join(name(address));
            let draft = folder.join(format!(".{}.{}", name(address), process::id()));
            match fs::remove_file(&draft) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => {}
            }
            let mut file = private_file(&draft)?;
            file.lock()?;
            file.write_all(text.as_bytes())?;
            fs::rename(&draft, &path)?;
            self.files.push((path, file));
        }
        Ok(())
    }

    /// Returns the paths of the files, one per address.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|(path, _)| path.as_path())
    }
}

impl Drop for Published {
    fn drop(&mut self) {
        if let Some(accounts) = of_this_process().as_mut() {
            for address in &self.addresses {
                accounts.remove(address);
            }
        }
        let _lock = self
            .files
            .first()
            .and_then(|(path, _)| lock(path.parent()?));
        for (path, file) in self.files.drain(..) {
            // Another broker may have replaced the file.
            if is_same(&path, &file)
                && let Err(error) = fs::remove_file(&path)
            {
                log::warn!("{} could not be removed: {error}", path.display());
            }
        }
    }
}

/// Returns the account of a broker of this user on this machine, if the URL belongs to one.
pub(crate) fn find(url: &BrokerUrl) -> Option<UserAndPassword> {
    if url.scheme == Scheme::Unix {
        return None;
    }
    let host = url.host.to_ascii_lowercase();
    let addresses = if host == "localhost" || host.ends_with(".localhost") {
        vec![
            IpAddr::V4(Ipv4Addr::LOCALHOST),
            IpAddr::V6(Ipv6Addr::LOCALHOST),
        ]
    } else {
        host.parse()
            .ok()
            .filter(IpAddr::is_loopback)
            .into_iter()
            .collect()
    };
    addresses
        .into_iter()
        .find_map(|address| known(SocketAddr::new(address, url.port)))
}

fn known(address: SocketAddr) -> Option<UserAndPassword> {
    let account = of_this_process()
        .as_ref()
        .and_then(|accounts| accounts.get(&address).cloned());
    account.or_else(|| read(&folder()?.join(name(address))))
}

/// Reads the account in a file; `None` if the program that wrote it has ended.
fn read(path: &Path) -> Option<UserAndPassword> {
    let file = File::open(path).ok()?;
    if file.try_lock_shared().is_ok() {
        return None;
    }
    let mut text = String::new();
    file.take(LARGEST_FILE).read_to_string(&mut text).ok()?;
    let value = |name: &str| {
        text.lines()
            .filter_map(|line| line.strip_prefix("export ")?.split_once('='))
            .find_map(|(key, value)| (key == name).then(|| value.to_owned()))
    };
    Some((
        value("SWARMWRIGHT_USERNAME")?,
        value("SWARMWRIGHT_PASSWORD")?,
    ))
}

/// Returns the folder of the accounts: `XDG_STATE_HOME` or `~/.local/state`, with the host name, since machines may
/// share a home directory.
fn folder() -> Option<PathBuf> {
    let absolute = |name: &str| {
        env::var_os(name)
            .map(PathBuf::from)
            .filter(|path| path.is_absolute())
    };
    let state = absolute("XDG_STATE_HOME")
        .or_else(|| absolute("HOME").map(|home| home.join(".local/state")))?;
    let host = gethostname::gethostname();
    Some(state.join("swarmwright/brokers").join(host))
}

fn name(address: SocketAddr) -> String {
    format!("{}-{}.env", address.ip(), address.port())
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

/// Removes the files of programs that have ended.
fn remove_stale(folder: &Path) {
    for path in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = path.path();
        // A program holds the lock on the folder until its own file is locked.
        let is_stale = File::open(&path).is_ok_and(|file| file.try_lock_shared().is_ok());
        if is_stale && let Err(error) = fs::remove_file(&path) {
            log::warn!("{} could not be removed: {error}", path.display());
        }
    }
}

#[cfg(unix)]
fn create_private(folder: &Path) -> io::Result<()> {
    use std::os::unix::fs::DirBuilderExt;
    DirBuilder::new().recursive(true).mode(0o700).create(folder)
}

#[cfg(not(unix))]
fn create_private(folder: &Path) -> io::Result<()> {
    DirBuilder::new().recursive(true).create(folder)
}

/// Creates a file that only this user can read.
fn private_file(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt;
        options.mode(0o600);
    }
    options.open(path)
}

#[cfg(unix)]
fn is_same(path: &Path, file: &File) -> bool {
    use std::os::unix::fs::MetadataExt;
    let of = |data: fs::Metadata| (data.dev(), data.ino());
    match (fs::symlink_metadata(path), file.metadata()) {
        (Ok(at_path), Ok(opened)) => of(at_path) == of(opened),
        _ => false,
    }
}

#[cfg(not(unix))]
fn is_same(path: &Path, _file: &File) -> bool {
    path.exists()
}
