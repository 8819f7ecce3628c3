//! Checks of owner, mode and links. A file that another user can change is not used: that user
//! could replace it, truncate memory that this process has mapped (SIGBUS), or forge answers.

use std::fs::{self, File, Metadata, OpenOptions, Permissions};
use std::io::{ErrorKind, Read};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::Path;
use std::sync::{Arc, OnceLock};

use pairmask_wire::InstanceError;
use rustix::fs::OFlags;
use rustix::process::{getegid, geteuid, getgid, getuid};

/// Wraps the system's error on a file.
pub(super) fn io_error(path: &Path) -> impl FnOnce(std::io::Error) -> InstanceError + '_ {
    move |source| InstanceError::Io { path: path.to_owned(), source: Arc::new(source) }
}

/// Environment variable by which a client consents to use what this other user owns: its daemon may forge answers, and
/// cut memory that this process reads. A number.
const TRUSTED_VARIABLE: &str = "PAIRMASK_TRUST_UID";

/// The user whom this process trusts beside its own.
fn trusted_user() -> Option<u32> {
    static TRUSTED: OnceLock<Option<u32>> = OnceLock::new();
    *TRUSTED.get_or_init(|| {
        // A program with set-user-id has its environment from those whom it must not trust.
        let is_plain = getuid() == geteuid() && getgid() == getegid();
        std::env::var(TRUSTED_VARIABLE).ok().filter(|_| is_plain)?.parse().ok()
    })
}

/// Whether a client uses what this user owns: its own effective user, or the one of [`TRUSTED_VARIABLE`].
pub(super) fn is_trusted(user: u32) -> bool {
    user == geteuid().as_raw() || trusted_user() == Some(user)
}

/// Mode bits: users other than the owner may write.
const OTHERS_WRITE: u32 = 0o022;
/// Whether a file is owned by the process's effective user. Root's files are no exception: only
/// root uses them.
pub(super) fn is_own(data: &Metadata) -> bool {
    data.uid() == geteuid().as_raw()
}

fn check(path: &Path, data: &Metadata) -> Result<(), InstanceError> {
    if !is_trusted(data.uid()) {
        return Err(InstanceError::Foreign { path: path.to_owned(), owner: data.uid() });
    }
    let mode = data.mode() & 0o7777;
    if mode & OTHERS_WRITE != 0 {
        return Err(InstanceError::Open { path: path.to_owned(), mode });
    }
    Ok(())
}

/// Checks that a path is a directory and no link, and that it is the user's own or a trusted one's.
pub(super) fn check_directory(path: &Path) -> Result<(), InstanceError> {
    let data = fs::symlink_metadata(path).map_err(io_error(path))?;
    if data.is_symlink() && !is_trusted(data.uid()) {
        return Err(InstanceError::Foreign { path: path.to_owned(), owner: data.uid() });
    }
    if !data.is_dir() {
        return Err(InstanceError::NotPlain { path: path.to_owned(), expected: "a directory" });
    }
    check(path, &data)
}

/// Checks that an open file is a plain one with one name at most, and that it is the user's own or a trusted one's.
pub(super) fn check_file(path: &Path, file: &File) -> Result<(), InstanceError> {
    let data = file.metadata().map_err(io_error(path))?;
    check(path, &data)?;
    // A file that was replaced since it was opened has no name any more, and is valid.
    if !data.is_file() || data.nlink() > 1 {
        return Err(InstanceError::NotPlain { path: path.to_owned(), expected: "a plain file" });
    }
    Ok(())
}

/// Opens a file by `options`, follows no link, and does not wait for the other end of a pipe.
pub(super) fn open_plain(path: &Path, options: &mut OpenOptions) -> Result<File, InstanceError> {
    let flags = OFlags::NOFOLLOW | OFlags::CLOEXEC | OFlags::NONBLOCK;
    options.custom_flags(flags.bits() as i32).open(path).map_err(|error| {
        // The error of `open` for a link that it must not follow.
        if error.raw_os_error() == Some(rustix::io::Errno::LOOP.raw_os_error()) {
            return InstanceError::NotPlain { path: path.to_owned(), expected: "a plain file" };
        }
        io_error(path)(error)
    })
}

/// Reads a small file of the user's own or of a trusted one; `None` where there is none.
pub(super) fn read_own(path: &Path, most: u64) -> Result<Option<Vec<u8>>, InstanceError> {
    let file = match open_plain(path, OpenOptions::new().read(true)) {
        Ok(file) => file,
        Err(InstanceError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {
            return Ok(None);
        }
        // An error that names the owner says more than one that names a missing right or a link.
        Err(error) => {
            return Err(match fs::symlink_metadata(path) {
                Ok(data) if !is_trusted(data.uid()) => {
                    InstanceError::Foreign { path: path.to_owned(), owner: data.uid() }
                }
                _ => error,
            });
        }
    };
    check_file(path, &file)?;
    let mut bytes = Vec::new();
    file.take(most).read_to_end(&mut bytes).map_err(io_error(path))?;
    Ok(Some(bytes))
}

/// Replaces a small file in one step. All users may read it who reach it; where it is `shared`, its group, whatever
/// the process's mask of modes.
pub(super) fn replace_own(
    new: &Path,
    path: &Path,
    bytes: &[u8],
    shared: bool,
) -> Result<(), InstanceError> {
    use std::io::Write;
    let mut options = OpenOptions::new();
    let mut file = open_plain(new, options.create(true).write(true).truncate(true).mode(0o644))?;
    check_file(new, &file)?;
    if shared {
        file.set_permissions(Permissions::from_mode(0o640)).map_err(io_error(new))?;
    }
    file.write_all(bytes).map_err(io_error(new))?;
    fs::rename(new, path).map_err(io_error(path))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::os::unix::fs::symlink;
    use std::path::PathBuf;

    use super::*;

    /// A directory of this test's own.
    fn directory(name: &str) -> PathBuf {
        let path =
            std::env::temp_dir().join(format!("pairmask-trust-{}-{name}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).unwrap();
        path
    }

    #[test]
    fn directories_that_others_may_write_to_and_links_are_refused() {
        let dir = directory("directories");
        check_directory(&dir).unwrap();
        for mode in [0o775, 0o757, 0o777, 0o1777] {
            fs::set_permissions(&dir, PermissionsExt::from_mode(mode)).unwrap();
            let refused = check_directory(&dir).unwrap_err();
            assert!(matches!(refused, InstanceError::Open { .. }), "{mode:o}: {refused}");
        }
        fs::set_permissions(&dir, PermissionsExt::from_mode(0o700)).unwrap();
        check_directory(&dir).unwrap();
        let (link, file) = (dir.join("link"), dir.join("file"));
        symlink(&dir, &link).unwrap();
        fs::write(&file, "x").unwrap();
        for path in [&link, &file] {
            let refused = check_directory(path).unwrap_err();
            assert!(matches!(refused, InstanceError::NotPlain { .. }), "{refused}");
        }
        fs::remove_dir_all(dir).unwrap();
    }

    #[test]
    fn files_that_others_may_write_to_and_links_are_refused() {
        let dir = directory("files");
        let (file, link, second) = (dir.join("file"), dir.join("link"), dir.join("second"));
        assert_eq!(read_own(&file, 9).unwrap(), None);
        replace_own(&dir.join("new"), &file, b"hello", false).unwrap();
        assert_eq!(read_own(&file, 9).unwrap().unwrap(), b"hello");
        assert_eq!(read_own(&file, 2).unwrap().unwrap(), b"he");
        symlink(&file, &link).unwrap();
        assert!(matches!(read_own(&link, 9), Err(InstanceError::NotPlain { .. })));
        assert!(matches!(read_own(&dir, 9), Err(InstanceError::NotPlain { .. })));
        // Writing a record follows no link.
        fs::rename(&link, dir.join("new")).unwrap();
        let refused = replace_own(&dir.join("new"), &second, b"bye", false).unwrap_err();
        assert!(matches!(refused, InstanceError::NotPlain { .. }), "{refused}");
        assert_eq!(fs::read(&file).unwrap(), b"hello");
        fs::hard_link(&file, &second).unwrap();
        assert!(matches!(read_own(&file, 9), Err(InstanceError::NotPlain { .. })));
        fs::remove_file(&second).unwrap();
        for mode in [0o664, 0o646] {
            fs::set_permissions(&file, PermissionsExt::from_mode(mode)).unwrap();
            assert!(matches!(read_own(&file, 9), Err(InstanceError::Open { .. })), "{mode:o}");
        }
        fs::remove_dir_all(dir).unwrap();
    }

    /// A reader that opened a pipe without a writer would wait for one without end.
    #[test]
    fn a_pipe_instead_of_a_file_is_refused_at_once() {
        let dir = directory("pipe");
        let pipe = dir.join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
        assert!(made.success());
        fs::set_permissions(&pipe, PermissionsExt::from_mode(0o600)).unwrap();
        assert!(matches!(read_own(&pipe, 9), Err(InstanceError::NotPlain { .. })));
        fs::remove_dir_all(dir).unwrap();
    }
}
