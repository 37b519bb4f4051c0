//! The stream of a workbook in a compound file, the container of `.xls`.

/// Marks the end of a chain of sectors, or a sector without content.
const LAST_REGULAR: u32 = 0xFFFF_FFFA;
/// Size of an entry of the directory in bytes.
const ENTRY: usize = 128;
/// Place of the first list of sectors of the allocation table, in bytes.
const FIRST_LIST: usize = 76;

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

fn numbers(bytes: &[u8]) -> Vec<u32> {
    let whole = bytes.chunks_exact(4);
    whole.filter_map(|chunk| u32_at(chunk, 0)).collect()
}

struct CompoundFile<'a> {
    bytes: &'a [u8],
    /// Size of a sector in bytes.
    sector: usize,
    /// The sector that follows each one.
    next: Vec<u32>,
}

impl<'a> CompoundFile<'a> {
    fn sector(&self, number: u32) -> Option<&'a [u8]> {
        let at = (usize::try_from(number).ok()? + 1).checked_mul(self.sector)?;
        // The last sector of a file may be cut short.
        let end = at.checked_add(self.sector)?.min(self.bytes.len());
        self.bytes.get(at..end)
    }

    /// Content of the sectors from this one on.
    fn chain(&self, first: u32) -> Option<Vec<u8>> {
        let mut content = Vec::new();
        for number in links(first, &self.next)? {
            content.extend_from_slice(self.sector(number)?);
        }
        Some(content)
    }
}

/// The chain from a first number on; `None` if it does not end.
fn links(first: u32, next: &[u32]) -> Option<Vec<u32>> {
    let (mut all, mut at) = (Vec::new(), first);
    while at < LAST_REGULAR {
        if all.len() > next.len() {
            return None;
        }
        all.push(at);
        at = *next.get(usize::try_from(at).ok()?)?;
    }
    Some(all)
}

/// The stream `Workbook`, or `Book` of older files; `None` if the file is not whole.
pub fn workbook(bytes: &[u8]) -> Option<Vec<u8>> {
    let shift = u32::from(u16_at(bytes, 30)?);
    let small_shift = u32::from(u16_at(bytes, 32)?);
    let mut file = CompoundFile {
        bytes,
        sector: 1_usize
            .checked_shl(shift)
            .filter(|size| (64..=65_536).contains(size))?,
        next: Vec::new(),
    };
    let mut lists = numbers(bytes.get(FIRST_LIST..512)?);
    let mut list = u32_at(bytes, 68)?;
    for _ in 0..u32_at(bytes, 72)?.min(4096) {
        if list >= LAST_REGULAR {
            break;
        }
        let mut further = numbers(file.sector(list)?);
        list = further.pop()?;
        lists.extend(further);
    }
    for number in lists.into_iter().filter(|number| *number < LAST_REGULAR) {
        file.next.extend(numbers(file.sector(number)?));
    }
    let directory = file.chain(u32_at(bytes, 48)?)?;
    let entry = |wanted: &[&str]| {
        directory.chunks_exact(ENTRY).find(|entry| {
            let n = usize::from(u16_at(entry, 64).unwrap_or(0)).min(64) / 2;
            let letters: Vec<u16> = (0..n).filter_map(|i| u16_at(entry, 2 * i)).collect();
            let name = String::from_utf16_lossy(&letters);
            wanted.contains(&name.trim_end_matches('\0'))
        })
    };
    let found = entry(&["Workbook", "Book"])?;
    let (first, size) = (u32_at(found, 116)?, u32_at(found, 120)?);
    if size >= u32_at(bytes, 56)? {
        return file.chain(first);
    }
    // Small streams share the stream of the root.
    let small = 1_usize
        .checked_shl(small_shift)
        .filter(|size| (1..=4096).contains(size))?;
    let shared = file.chain(u32_at(entry(&["Root Entry"])?, 116)?)?;
    let next = numbers(&file.chain(u32_at(bytes, 60)?)?);
    let mut content = Vec::new();
    for number in links(first, &next)? {
        let at = usize::try_from(number).ok()?.checked_mul(small)?;
        content.extend_from_slice(shared.get(at..(at + small).min(shared.len()))?);
    }
    Some(content)
}
