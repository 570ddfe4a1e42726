//! A board's image: the ELF file as it is built, its segments and the names of its functions.

use std::path::{Path, PathBuf};

use object::read::elf::{ElfFile32, ProgramHeader};
use object::{Endianness, Object, ObjectSymbol, SymbolKind, elf};

use crate::chip::{Board, Variant};

/// A file that was built for a board, by what follows the board's name in its name.
fn built(board: &Board, behind: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let name = format!("mobgate-{}{behind}", board.name.replace('_', "-"));
    root.join("target/thumb/thumbv7em-none-eabihf/release").join(name)
}

/// The update file of a board's image.
pub fn update_file(board: Board) -> PathBuf {
    built(&board, ".mgu")
}

/// What a tool would write into the flash, and where functions are.
pub struct Image {
    /// Addresses and bytes.
    pub(crate) segments: Vec<(u32, Vec<u8>)>,
    /// Where functions begin, sorted.
    functions: Vec<(u32, String)>,
    /// Where the stack's memory begins and ends.
    pub(crate) stack: (u32, u32),
}

impl Image {
    /// Reads the file at `path`.
    pub fn read(path: &Path) -> Result<Self, String> {
        let fault = |what: &dyn std::fmt::Display| format!("{}: {what}", path.display());
        let bytes = std::fs::read(path).map_err(|error| fault(&error))?;
        let file = ElfFile32::<Endianness>::parse(&*bytes).map_err(|error| fault(&error))?;
        let mut segments = Vec::new();
        for header in file.elf_program_headers() {
            let data = header
                .data(file.endian(), &*bytes)
                .map_err(|()| fault(&"a segment ends outside the file"))?;
            if header.p_type(file.endian()) == elf::PT_LOAD && !data.is_empty() {
                segments.push((header.p_paddr(file.endian()), data.to_vec()));
            }
        }
        let functions = file.symbols().filter(|symbol| symbol.kind() == SymbolKind::Text);
        let mut functions: Vec<_> = functions
            .filter_map(|symbol| Some((symbol.address() as u32 & !1, symbol.name().ok()?)))
            .filter(|(_, name)| !name.starts_with('$'))
            .map(|(address, name)| (address, format!("{:#}", rustc_demangle::demangle(name))))
            .collect();
        functions.sort();
        let symbol = |name: &str| file.symbol_by_name(name).map(|symbol| symbol.address() as u32);
        let stack = (symbol("_stack_end").unwrap_or_default(), symbol("_stack_start").unwrap_or_default());
        Ok(Self { segments, functions, stack })
    }

    /// Reads the image of a board and its boot loader, as `cargo xtask test stm32` leaves them.
    pub fn of_board(board: &Board) -> Result<Self, String> {
        let read = |behind: &str| {
            Self::read(&built(board, behind))
                .map_err(|error| format!("{error}\nbuild it first: cargo xtask test stm32"))
        };
        let program = match board.image {
            Variant::Ethercat => "",
            Variant::Smaller => "-without-ethercat",
            Variant::Users => "-with-users",
        };
        let (mut program, boot) = (read(program)?, read("-boot")?);
        program.segments.extend(boot.segments);
        program.functions.extend(boot.functions);
        program.functions.sort();
        Ok(program)
    }

    /// Where its last byte in this part of the flash ends.
    pub(crate) fn end(&self, (start, length): (u32, u32)) -> u32 {
        let ends = self.segments.iter().map(|(at, bytes)| at + bytes.len() as u32);
        ends.filter(|end| (start..=start + length).contains(end)).max().unwrap_or(start)
    }

    /// The first instruction from `start` on that calls the function of this `name` there.
    pub(crate) fn call_of(&self, name: &str, start: u32) -> Option<u32> {
        let &(function, _) = self.functions.iter().find(|(at, known)| *at >= start && known == name)?;
        self.segments.iter().filter(|(at, _)| *at >= start).find_map(|(at, bytes)| {
            let mut sites = (0..bytes.len().saturating_sub(3)).step_by(2);
            let site = sites.find(|&site| called(at + site as u32, &bytes[site..]) == Some(function))?;
            Some(at + site as u32)
        })
    }

    /// The function that the instruction at `address` belongs to.
    pub(crate) fn function(&self, address: u32) -> &str {
        let after = self.functions.partition_point(|(start, _)| *start <= address);
        after.checked_sub(1).map_or("?", |index| &self.functions[index].1)
    }
}

/// What the BL at `site` calls, if `code` begins with one (ARMv7-M architecture, A7.7.18, encoding T1).
fn called(site: u32, code: &[u8]) -> Option<u32> {
    let [first, second] = [0, 2].map(|at| u32::from(u16::from_le_bytes([code[at], code[at + 1]])));
    if first & 0xf800 != 0xf000 || second & 0xd000 != 0xd000 {
        return None;
    }
    let sign = first >> 10 & 1;
    let bits = [13, 11].map(|bit| !(second >> bit ^ sign) & 1);
    let offset = sign << 24 | bits[0] << 23 | bits[1] << 22 | (first & 0x3ff) << 12 | (second & 0x7ff) << 1;
    // From 25 bits with a sign.
    Some(site.wrapping_add(4).wrapping_add_signed((offset << 7).cast_signed() >> 7))
}
