//! Clients and daemons that speak the wire contract without the library, and so can break it: their memory is their
//! own, and they write what they like into it.
#![allow(unsafe_code)]

use std::cell::Cell;
use std::io::{IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use pairmask_core::engine::EngineChoice;
use pairmask_core::precision::BoxForm;
use pairmask_core::units::BoxCount;
use pairmask_transport::RuntimeDir;
use pairmask_wire::board::{BOARD_PAGES, ENTRIES_AT, ENTRY_BYTES, Entry, PLACES, Placed};
use pairmask_wire::{
    CullRequest, PAGE_BYTES, Page, RequestHeader, ResponseHeader, SceneSections, VERSION_MAJOR,
    VERSION_MINOR,
};
use pairmaskd::scene::Random;
use rustix::fs::{MemfdFlags, fstat, ftruncate, memfd_create};
use rustix::mm::{MapFlags, ProtFlags, mmap};
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, SocketAddrUnix, SocketFlags, SocketType, accept, bind,
    connect, listen, recvmsg, sendmsg, socket_with, socketpair,
};

/// Offset of the words of a board that say what was let go of.
const RELEASED_AT: usize = 8 * PLACES;

/// Memory that is mapped until the process ends.
#[derive(Clone, Copy, Debug)]
pub struct Mapped {
    pub start: usize,
    pub bytes: usize,
}

impl Mapped {
    fn of(file: &OwnedFd, is_own: bool) -> Option<Self> {
        let bytes = usize::try_from(fstat(file).ok()?.st_size).ok()?;
        let access = if is_own { ProtFlags::READ | ProtFlags::WRITE } else { ProtFlags::READ };
        // SAFETY: the kernel chooses a free address.
        let start =
            unsafe { mmap(std::ptr::null_mut(), bytes, access, MapFlags::SHARED, file, 0) }.ok()?;
        Some(Self { start: start.expose_provenance(), bytes })
    }
}

/// Own memory, and the file that others map.
#[derive(Debug)]
pub struct Memory {
    pub mapped: Mapped,
    pub file: OwnedFd,
}

impl Memory {
    pub fn new(pages: usize) -> Option<Self> {
        let file = memfd_create("hostile", MemfdFlags::CLOEXEC).ok()?;
        ftruncate(&file, (pages * PAGE_BYTES) as u64).ok()?;
        Some(Self { mapped: Mapped::of(&file, true)?, file })
    }
}

/// A board, own or not: it begins at this address.
#[derive(Clone, Copy, Debug)]
pub struct Board(pub usize);

impl Board {
    pub fn sent(self, place: usize) -> u64 {
        read(self.0 + 8 * place)
    }

    pub fn released(self, place: usize) -> u64 {
        read(self.0 + RELEASED_AT + 8 * place)
    }

    pub fn release(self, place: usize, number: u64) {
        write(self.0 + RELEASED_AT + 8 * place, number);
    }

    /// Address of an entry.
    pub fn entry(self, place: usize) -> usize {
        self.0 + ENTRIES_AT + place * ENTRY_BYTES
    }

    pub fn header<H: Copy>(self, place: usize) -> H {
        // SAFETY: callers ask for the headers of the wire contract, of which any bytes are valid, in mapped memory.
        unsafe { self.entry_pointer::<H>(place).read_volatile() }.header
    }

    fn entry_pointer<H>(self, place: usize) -> *mut Entry<H> {
        std::ptr::with_exposed_provenance_mut(self.entry(place))
    }

    pub fn send<H>(self, place: usize, number: u64, placed: Placed, header: H) {
        // SAFETY: the entry lies in memory of this process's own, which stays mapped.
        unsafe { self.entry_pointer(place).write_volatile(Entry { placed, header }) };
        write(self.0 + 8 * place, number);
    }
}

fn socket_path(dir: &RuntimeDir) -> PathBuf {
    dir.path().join("default.socket")
}

fn socket_at(path: &Path) -> Option<(OwnedFd, SocketAddrUnix)> {
    let flags = SocketFlags::CLOEXEC;
    let socket = socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None).ok()?;
    Some((socket, SocketAddrUnix::new(path).ok()?))
}

/// A message of the socket: "PMSO", a word, and the place of a board.
fn say(socket: &OwnedFd, word: u32, board: u64, files: &[&OwnedFd]) -> Option<()> {
    let mut message = [0; 16];
    message[..4].copy_from_slice(b"PMSO");
    message[4..8].copy_from_slice(&word.to_le_bytes());
    message[8..].copy_from_slice(&board.to_le_bytes());
    say_bytes(socket, &message, files)
}

/// Any bytes, with descriptors.
pub fn say_bytes(socket: &OwnedFd, bytes: &[u8], files: &[&OwnedFd]) -> Option<()> {
    let files: Vec<_> = files.iter().map(|file| file.as_fd()).collect();
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(8))];
    let mut control = SendAncillaryBuffer::new(&mut space);
    control.push(SendAncillaryMessage::ScmRights(&files)).then_some(())?;
    sendmsg(socket, &[IoSlice::new(bytes)], &mut control, SendFlags::NOSIGNAL).ok()?;
    Some(())
}

/// Waits for a message: its word, the place of a board, and descriptors.
fn hear(socket: &OwnedFd) -> Option<(u32, u64, Vec<OwnedFd>)> {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(8))];
    let mut control = RecvAncillaryBuffer::new(&mut space);
    let mut message = [0; 16];
    let mut bytes = [IoSliceMut::new(&mut message)];
    let heard = recvmsg(socket, &mut bytes, &mut control, RecvFlags::CMSG_CLOEXEC).ok()?;
    let rights = control.drain().filter_map(|part| match part {
        RecvAncillaryMessage::ScmRights(files) => Some(files),
        _ => None,
    });
    let files = rights.flatten().collect();
    let word = u32::from_le_bytes(message[4..8].try_into().ok()?);
    let board = u64::from_le_bytes(message[8..].try_into().ok()?);
    (heard.bytes == 16).then_some((word, board, files))
}

const VERSION: u32 = VERSION_MAJOR as u32 | (VERSION_MINOR as u32) << 16;

/// Asks to be let in with this memory: the place of the daemon's board, and its descriptors.
pub fn ask_in(dir: &RuntimeDir, memory: &OwnedFd) -> Option<(OwnedFd, u64, Vec<OwnedFd>)> {
    let (socket, address) = socket_at(&socket_path(dir))?;
    connect(&socket, &address).ok()?;
    say(&socket, VERSION, 0, &[memory])?;
    let (_, board, files) = hear(&socket)?;
    Some((socket, board, files))
}

/// Connects, says these bytes, and nothing else.
pub fn knock(dir: &RuntimeDir, bytes: &[u8]) -> Option<OwnedFd> {
    let (socket, address) = socket_at(&socket_path(dir))?;
    connect(&socket, &address).ok()?;
    if !bytes.is_empty() {
        say_bytes(&socket, bytes, &[])?;
    }
    Some(socket)
}

pub struct RawClient {
    pub socket: OwnedFd,
    /// A board, and as many pieces as there are places.
    pub memory: Memory,
    pub their_file: OwnedFd,
    pub theirs: Mapped,
    pub their_board: Board,
    bell: OwnedFd,
    pages: usize,
    next: Cell<u64>,
}

/// Memory for a request of a raw client.
#[derive(Debug)]
pub struct RawLoan {
    pub place: usize,
    pub header: RequestHeader,
    pub placed: Placed,
    address: usize,
}

impl RawLoan {
    pub fn pages_mut(&mut self) -> &mut [Page] {
        let first = std::ptr::with_exposed_provenance_mut(self.address);
        // SAFETY: the piece is this process's own, and stays mapped; any bytes are a valid Page.
        unsafe { std::slice::from_raw_parts_mut(first, self.placed.pages as usize) }
    }
}

/// A request of a raw client. Dropped, it is let go of.
pub struct RawPending<'a> {
    client: &'a RawClient,
    pub place: usize,
    pub number: u64,
}

impl RawClient {
    /// Connects to the daemon of the environment's directory, if it serves. Requests have so many pages.
    pub fn connect(pages: usize) -> Option<Self> {
        Self::connect_at(&RuntimeDir::from_env(), pages)
    }

    /// As [`Self::connect`], in another directory.
    pub fn connect_at(dir: &RuntimeDir, pages: usize) -> Option<Self> {
        let memory = Memory::new(BOARD_PAGES + PLACES * pages)?;
        let (socket, board, files) = ask_in(dir, &memory.file)?;
        let [segment, bell] = <[OwnedFd; 2]>::try_from(files).ok()?;
        let theirs = Mapped::of(&segment, false)?;
        let their_board = Board(theirs.start + board as usize);
        Some(Self {
            socket,
            memory,
            their_file: segment,
            theirs,
            their_board,
            bell,
            pages,
            next: Cell::new(1),
        })
    }

    /// As [`Self::connect`], as soon as there is a daemon.
    pub fn reconnect(pages: usize, until: &super::Until) -> Option<Self> {
        while !until.is_over() {
            if let Some(client) = Self::connect(pages) {
                return Some(client);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        None
    }

    pub fn board(&self) -> Board {
        Board(self.memory.mapped.start)
    }

    /// Memory in a place that the daemon has let go of; `None` where it does not let go of any.
    pub fn loan(&self) -> Option<RawLoan> {
        self.loan_within(Duration::from_secs(1))
    }

    /// As [`Self::loan`], within a time.
    pub fn loan_within(&self, time: Duration) -> Option<RawLoan> {
        let give_up_at = Instant::now() + time;
        let is_free = |place: &usize| {
            let sent = self.board().sent(*place);
            sent == 0 || self.their_board.released(*place) == sent
        };
        let place = loop {
            if let Some(free) = (0..PLACES).find(is_free) {
                break free;
            }
            if Instant::now() >= give_up_at {
                return None;
            }
            std::thread::sleep(Duration::from_micros(50));
        };
        let offset = (BOARD_PAGES + place * self.pages) * PAGE_BYTES;
        let placed = Placed { segment: 0, offset: offset as u64, pages: self.pages as u64 };
        let address = self.memory.mapped.start + offset;
        Some(RawLoan { place, header: RequestHeader::default(), placed, address })
    }

    #[allow(clippy::needless_pass_by_value)] // Its memory is the daemon's from then on.
    pub fn send(&self, loan: RawLoan) -> RawPending<'_> {
        let RawLoan { place, header, placed, address: _ } = loan;
        let number = self.next.replace(self.next.get() + 1);
        self.board().send(place, number, placed, header);
        self.wake();
        RawPending { client: self, place, number }
    }

    /// Sends a further segment. Whether the daemon has mapped it.
    pub fn add_segment(&self, file: &OwnedFd) -> bool {
        say(&self.socket, VERSION, 0, &[file]).is_some() && hear(&self.socket).is_some()
    }

    /// Wakes the daemon.
    pub fn wake(&self) {
        let _ = rustix::net::send(&self.bell, &[1], SendFlags::NOSIGNAL | SendFlags::DONTWAIT);
    }
}

impl RawPending<'_> {
    pub fn is_answered(&self) -> bool {
        self.client.their_board.sent(self.place) == self.number
    }

    pub fn answer(&self, within: Duration) -> Option<ResponseHeader> {
        let give_up_at = Instant::now() + within;
        while !self.is_answered() {
            if Instant::now() >= give_up_at {
                return None;
            }
            std::thread::sleep(Duration::from_micros(50));
        }
        Some(self.client.their_board.header(self.place))
    }
}

impl Drop for RawPending<'_> {
    fn drop(&mut self) {
        self.client.board().release(self.place, self.number);
    }
}

/// A request to a raw daemon, whose answers lie in a page of this process.
pub struct RawRequest {
    pub header: RequestHeader,
    /// The daemon's board in this session.
    pub board: Board,
    pub place: usize,
    pub number: u64,
    /// Where the page is: for the client, and here.
    pub placed: Placed,
    pub page: usize,
}

impl RawRequest {
    pub fn answer(&self, header: ResponseHeader) {
        self.board.send(self.place, self.number, self.placed, header);
    }
}

struct RawPeer {
    socket: OwnedFd,
    theirs: Board,
    own: Memory,
    seen: [u64; PLACES],
    _bell: OwnedFd,
}

impl RawPeer {
    fn let_in(socket: OwnedFd) -> Option<Self> {
        let (_, board, files) = hear(&socket)?;
        let theirs = Mapped::of(files.first()?, false)?;
        let own = Memory::new(BOARD_PAGES + PLACES)?;
        // One that waits, also where the client asks not to.
        let flags = SocketFlags::CLOEXEC;
        let (bell, their_end) =
            socketpair(AddressFamily::UNIX, SocketType::STREAM, flags, None).ok()?;
        say(&socket, 0, 0, &[&own.file, &their_end])?;
        let theirs = Board(theirs.start + board as usize);
        rustix::io::ioctl_fionbio(&socket, true).ok()?;
        Some(Self { socket, theirs, own, seen: [0; PLACES], _bell: bell })
    }
}

/// Serves until it is over: `answer` gets each request.
pub fn serve(
    dir: &RuntimeDir,
    is_over: impl Fn() -> bool,
    mut answer: impl FnMut(RawRequest),
) -> Option<()> {
    let path = socket_path(dir);
    let (listener, address) = socket_at(&path)?;
    let _ = std::fs::remove_file(&path);
    bind(&listener, &address).ok()?;
    listen(&listener, 8).ok()?;
    rustix::io::ioctl_fionbio(&listener, true).ok()?;
    let mut peers: Vec<RawPeer> = Vec::new();
    while !is_over() {
        if let Ok(socket) = accept(&listener) {
            peers.extend(RawPeer::let_in(socket));
        }
        for peer in &mut peers {
            if hear(&peer.socket).is_some() {
                // A further segment, which this daemon does not read.
                let _ = say(&peer.socket, 4, 0, &[]);
            }
            for place in 0..PLACES {
                let number = peer.theirs.sent(place);
                if std::mem::replace(&mut peer.seen[place], number) == number {
                    continue;
                }
                let board = Board(peer.own.mapped.start);
                let offset = (BOARD_PAGES + place) * PAGE_BYTES;
                answer(RawRequest {
                    header: peer.theirs.header(place),
                    board,
                    place,
                    number,
                    placed: Placed { segment: 0, offset: offset as u64, pages: 1 },
                    page: board.0 + offset,
                });
                board.release(place, number);
            }
        }
        std::thread::sleep(Duration::from_micros(50));
    }
    Some(())
}

pub fn cull(frame: u64, n: u32, engine: EngineChoice) -> RequestHeader {
    let scene = SceneSections::first(BoxForm::F32, BoxCount::new(n));
    let request = CullRequest { engine, threads: Some(1), ..CullRequest::of(scene) };
    RequestHeader::cull(0, frame, &request)
}

pub fn write(address: usize, value: u64) {
    // SAFETY: callers take the address from memory of their own, which stays mapped; other processes treat it as shared
    // memory.
    unsafe { std::ptr::with_exposed_provenance_mut::<u64>(address).write_volatile(value) }
}

pub fn read(address: usize) -> u64 {
    // SAFETY: as in `write`, or memory that a daemon has sent.
    unsafe { std::ptr::with_exposed_provenance::<u64>(address).read_volatile() }
}

/// Numbers of chance, others in each process.
pub fn dice() -> Random {
    Random::new(u64::from(std::process::id()))
}
