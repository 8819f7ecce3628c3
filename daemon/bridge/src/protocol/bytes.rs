//! Little-endian fields and numbers of seven bits a byte, written and read. What is read was written by others: each read
//! is refused that goes beyond the end.

use super::Refused;

/// Bytes of a message that is being written.
#[derive(Clone, Debug, Default)]
pub(super) struct Writer(pub Vec<u8>);

impl Writer {
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }

    pub fn u8(&mut self, value: u8) {
        self.0.push(value);
    }

    pub fn u32(&mut self, value: u32) {
        self.bytes(&value.to_le_bytes());
    }

    pub fn u64(&mut self, value: u64) {
        self.bytes(&value.to_le_bytes());
    }

    /// A number, in as many bytes as it needs.
    pub fn number(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.u8(value as u8 | 0x80);
            value >>= 7;
        }
        self.u8(value as u8);
    }

    /// A difference, small where two numbers are near each other, whichever is the greater.
    pub fn difference(&mut self, from: u64, to: u64) {
        let by = to.wrapping_sub(from) as i64;
        self.number((by << 1 ^ by >> 63) as u64);
    }
}

/// What is left to read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reader<'a>(pub &'a [u8]);

impl<'a> Reader<'a> {
    pub fn bytes(&mut self, count: usize) -> Result<&'a [u8], Refused> {
        let (read, left) = self.0.split_at_checked(count).ok_or(Refused::Truncated)?;
        self.0 = left;
        Ok(read)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Refused> {
        self.bytes(N)?.try_into().map_err(|_| Refused::Truncated)
    }

    pub fn u8(&mut self) -> Result<u8, Refused> {
        Ok(self.array::<1>()?[0])
    }

    pub fn u32(&mut self) -> Result<u32, Refused> {
        self.array().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Result<u64, Refused> {
        self.array().map(u64::from_le_bytes)
    }

    pub fn f32(&mut self) -> Result<f32, Refused> {
        self.array().map(f32::from_le_bytes)
    }

    pub fn number(&mut self) -> Result<u64, Refused> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.u8()?;
            let bits = u64::from(byte & 0x7f);
            if bits << shift >> shift != bits {
                break;
            }
            value |= bits << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(Refused::Field("number"))
    }

    /// The number at a difference from another one.
    pub fn difference(&mut self, from: u64) -> Result<u64, Refused> {
        let folded = self.number()?;
        Ok(from.wrapping_add(folded >> 1 ^ (folded & 1).wrapping_neg()))
    }

    /// A count of entries that take at least so many bytes each: no more than there is room for.
    pub fn count(&mut self, entry_bytes: usize) -> Result<usize, Refused> {
        let count = self.number()?;
        let most = self.0.len() / entry_bytes;
        usize::try_from(count).ok().filter(|count| *count <= most).ok_or(Refused::Truncated)
    }

    pub const fn end(&self) -> Result<(), Refused> {
        if self.0.is_empty() { Ok(()) } else { Err(Refused::Field("bytes after the end")) }
    }
}
