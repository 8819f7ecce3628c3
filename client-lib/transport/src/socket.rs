//! The socket of an instance: who asks for a session, by the kernel's word, and descriptors of memory.
//!
//! A client connects once a session. What goes over the socket afterwards are descriptors of further segments; its
//! end is the end of the session on either side.
#![allow(unsafe_code)]

use std::fs;
use std::io::{self, ErrorKind, IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::path::Path;

use bytemuck::{Pod, Zeroable};
use pairmask_wire::InstanceError;
use rustix::fs::{Mode, OFlags, open};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, SocketAddrUnix, SocketFlags, SocketType, bind, connect,
    listen, recvmsg, sendmsg, socket_with, socketpair,
};

use crate::trust::{io_error, is_trusted};

/// "PMSO" in memory order: the first word of each message on the socket.
const MAGIC: u32 = u32::from_le_bytes(*b"PMSO");

/// Descriptors of a message, at most.
pub(super) const MOST_FILES: usize = 2;

/// A client's message: it begins its session, or has made a further segment. With it go a descriptor of the segment,
/// and nothing else.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Hello {
    magic: u32,
    /// Version of the wire contract.
    pub version_major: u16,
    /// Version of the wire contract.
    pub version_minor: u16,
    /// Offset of its board in its first segment; 0 for a further one.
    pub board: u64,
}

/// The daemon's answer, with descriptors of its segment and of a [`Bell`]; or the notice of a further segment, with a
/// descriptor of that.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Welcome {
    magic: u32,
    /// A [`Door`].
    door: u32,
    /// Offset of its board in its first segment.
    pub board: u64,
}

/// What the daemon says to who knocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Door {
    /// Come in.
    Open = 0,
    /// It has all the clients that it may have.
    Full = 1,
    /// It has no shared memory, or can open no more files.
    NoMemory = 2,
    /// It does not understand the client.
    Refused = 3,
    /// It has mapped a further segment of the client's.
    Mapped = 4,
}

impl Hello {
    /// A message of this build.
    pub const fn new(board: u64) -> Self {
        let (version_major, version_minor) =
            (pairmask_wire::VERSION_MAJOR, pairmask_wire::VERSION_MINOR);
        Self { magic: MAGIC, version_major, version_minor, board }
    }
}

impl Welcome {
    /// An answer.
    pub const fn new(door: Door, board: u64) -> Self {
        Self { magic: MAGIC, door: door as u32, board }
    }

    /// What the daemon says; `None` of one that this build does not know.
    pub fn door(&self) -> Option<Door> {
        let all = [Door::Open, Door::Full, Door::NoMemory, Door::Refused, Door::Mapped];
        all.into_iter().find(|door| *door as u32 == self.door)
    }
}

/// A message on the socket.
pub trait Message: Pod {
    /// Whether it begins as one does.
    fn is_one(&self) -> bool;
}

impl Message for Hello {
    fn is_one(&self) -> bool {
        self.magic == MAGIC
    }
}

impl Message for Welcome {
    fn is_one(&self) -> bool {
        self.magic == MAGIC
    }
}

/// The address of a socket's file, for `work`. One whose path is longer than an address can be is named by its
/// directory's descriptor.
fn at_address<R>(
    path: &Path,
    work: impl FnOnce(&SocketAddrUnix) -> rustix::io::Result<R>,
) -> io::Result<R> {
    if let Ok(address) = SocketAddrUnix::new(path) {
        return Ok(work(&address)?);
    }
    let (Some(parent), Some(name)) = (path.parent(), path.file_name()) else {
        return Err(ErrorKind::InvalidInput.into());
    };
    let dir = open(parent, OFlags::PATH | OFlags::DIRECTORY | OFlags::CLOEXEC, Mode::empty())?;
    let near = Path::new("/proc/self/fd").join(dir.as_raw_fd().to_string()).join(name);
    Ok(work(&SocketAddrUnix::new(near)?)?)
}

fn new_socket() -> io::Result<OwnedFd> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    Ok(socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?)
}

/// Clients that may wait to be let in: as many as there may be by default.
const BACKLOG: i32 = 128;

/// A socket at a path, in place of a predecessor's, with a mode that says who may connect to it.
pub(super) fn listen_at(path: &Path, mode: u32) -> Result<OwnedFd, InstanceError> {
    let listen = || {
        let socket = new_socket()?;
        match fs::remove_file(path) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            Ok(()) | Err(_) => {}
        }
        at_address(path, |address| bind(&socket, address))?;
        fs::set_permissions(path, fs::Permissions::from_mode(mode))?;
        listen(&socket, BACKLOG)?;
        Ok(socket)
    };
    listen().map_err(io_error(path))
}

/// Connects to the socket at a path, whose other end is this user's or a trusted one's.
pub(super) fn connect_to(path: &Path) -> Result<OwnedFd, InstanceError> {
    let data = fs::symlink_metadata(path).map_err(io_error(path))?;
    let foreign = |owner| InstanceError::Foreign { path: path.to_owned(), owner };
    if !is_trusted(data.uid()) {
        return Err(foreign(data.uid()));
    }
    if !data.file_type().is_socket() {
        return Err(InstanceError::NotPlain { path: path.to_owned(), expected: "a socket" });
    }
    let connect = || {
        let socket = new_socket()?;
        at_address(path, |address| connect(&socket, address))?;
        Ok(socket)
    };
    let socket = connect().map_err(io_error(path))?;
    let peer = peer_of(socket.as_fd()).map_err(io_error(path))?;
    if is_trusted(peer.user) { Ok(socket) } else { Err(foreign(peer.user)) }
}

/// The process at the other end, as the kernel knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PeerProcess {
    pub(super) user: u32,
    group: u32,
    /// 0 where it is in a PID namespace that this one does not see.
    pub(super) process: u32,
}

/// Who is at the other end of a socket.
pub(super) fn peer_of(socket: BorrowedFd<'_>) -> io::Result<PeerProcess> {
    // rustix has no words for a process of another PID namespace, whose number is 0.
    let mut credentials = libc::ucred { pid: 0, uid: 0, gid: 0 };
    let mut bytes = size_of::<libc::ucred>() as libc::socklen_t;
    let (level, option) = (libc::SOL_SOCKET, libc::SO_PEERCRED);
    let to = (&raw mut credentials).cast();
    // SAFETY: the option is a `ucred`, for which there is room, and `bytes` says how much.
    let done = unsafe { libc::getsockopt(socket.as_raw_fd(), level, option, to, &raw mut bytes) };
    if done != 0 {
        return Err(io::Error::last_os_error());
    }
    let (user, group) = (credentials.uid, credentials.gid);
    Ok(PeerProcess { user, group, process: credentials.pid as u32 })
}

/// Whether the process at the other end was in a group when it connected.
pub(super) fn is_in_group(socket: BorrowedFd<'_>, peer: &PeerProcess, group: u32) -> bool {
    peer.group == group || further_groups(socket).is_ok_and(|groups| groups.contains(&group))
}

/// The supplementary groups of the process at the other end.
fn further_groups(socket: BorrowedFd<'_>) -> io::Result<Vec<libc::gid_t>> {
    let mut groups: Vec<libc::gid_t> = vec![0; 32];
    loop {
        let mut bytes = size_of_val(groups.as_slice()) as libc::socklen_t;
        let (level, option) = (libc::SOL_SOCKET, libc::SO_PEERGROUPS);
        let (of, to) = (socket.as_raw_fd(), groups.as_mut_ptr().cast());
        // SAFETY: the option is a list of group ids, for which there is room of so many `bytes`.
        let done = unsafe { libc::getsockopt(of, level, option, to, &raw mut bytes) };
        let error = io::Error::last_os_error();
        let count = bytes as usize / size_of::<libc::gid_t>();
        if done == 0 {
            groups.truncate(count);
            return Ok(groups);
        }
        // There are more, and `bytes` says how many.
        if error.raw_os_error() != Some(libc::ERANGE) || count <= groups.len() {
            return Err(error);
        }
        groups.resize(count, 0);
    }
}

/// One end of a pair of sockets by which either side wakes the other. A wait is the kernel's flag of the call, and not of
/// the file, which the other side could change.
#[derive(Debug)]
pub(super) struct Bell(OwnedFd);

impl Bell {
    /// Both ends.
    pub(super) fn pair() -> io::Result<(Self, OwnedFd)> {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let (own, theirs) = socketpair(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
        Ok((Self(own), theirs))
    }

    /// The end that the other side has sent.
    pub(super) const fn of(end: OwnedFd) -> Self {
        Self(end)
    }

    /// Wakes the other side. One that has not taken earlier wake-ups yet is awake, or will be.
    pub(super) fn ring(&self) {
        let _ = rustix::net::send(&self.0, &[1], SendFlags::NOSIGNAL | SendFlags::DONTWAIT);
    }

    /// Takes the wake-ups that have come: they would end the next sleep at once. Whether more can come.
    pub(super) fn take(&self) -> bool {
        let taken = rustix::net::recv(&self.0, &mut [0; 64], RecvFlags::DONTWAIT);
        !matches!(taken, Ok((_, 0)) | Err(Errno::CONNRESET))
    }
}

impl AsFd for Bell {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// Sends a message with descriptors, at most [`MOST_FILES`], without waiting for room.
pub(super) fn send<M: Message>(
    socket: BorrowedFd<'_>,
    message: &M,
    files: &[BorrowedFd<'_>],
) -> io::Result<()> {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(MOST_FILES))];
    let mut control = SendAncillaryBuffer::new(&mut space);
    if !files.is_empty() && !control.push(SendAncillaryMessage::ScmRights(files)) {
        return Err(ErrorKind::InvalidInput.into());
    }
    let bytes = [IoSlice::new(bytemuck::bytes_of(message))];
    let sent = sendmsg(socket, &bytes, &mut control, SendFlags::NOSIGNAL | SendFlags::DONTWAIT)?;
    if sent == size_of::<M>() { Ok(()) } else { Err(ErrorKind::WriteZero.into()) }
}

/// What was received.
pub(super) enum Received<M> {
    Message(M, Vec<OwnedFd>),
    /// Nothing is there yet.
    Nothing,
    /// The other side has closed the socket, or sends what is no message.
    End,
}

/// Receives a message, if one is there.
pub(super) fn receive<M: Message>(socket: BorrowedFd<'_>) -> Received<M> {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(MOST_FILES))];
    let mut control = RecvAncillaryBuffer::new(&mut space);
    let mut message = M::zeroed();
    let received = {
        let mut bytes = [IoSliceMut::new(bytemuck::bytes_of_mut(&mut message))];
        recvmsg(socket, &mut bytes, &mut control, RecvFlags::DONTWAIT | RecvFlags::CMSG_CLOEXEC)
    };
    let mut files = Vec::new();
    for part in control.drain() {
        if let RecvAncillaryMessage::ScmRights(descriptors) = part {
            files.extend(descriptors);
        }
    }
    match received {
        Ok(received) if received.bytes == size_of::<M>() && message.is_one() => {
            Received::Message(message, files)
        }
        Err(Errno::AGAIN | Errno::INTR) => Received::Nothing,
        Ok(_) | Err(_) => Received::End,
    }
}
