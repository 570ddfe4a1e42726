//! A device's four tables and what the function codes do with them, Modbus Application Protocol 6.

use super::fresh::Fresh;

/// Entries of each table: addresses from here on are exception 02.
pub const TABLE_LENGTH: usize = 10_000;

const ILLEGAL_FUNCTION: u8 = 1;
const ILLEGAL_ADDRESS: u8 = 2;
const ILLEGAL_VALUE: u8 = 3;

/// The data that a device serves.
#[derive(Debug, Clone)]
pub struct Memory {
    /// Coils, functions 1, 5, 15.
    pub coils: Vec<bool>,
    /// Discrete inputs, function 2.
    pub discrete_inputs: Vec<bool>,
    /// Holding registers, functions 3, 6, 16, 22, 23.
    pub holding: Vec<u16>,
    /// Input registers, function 4.
    pub input: Vec<u16>,
    unit: u8,
    fresh: Option<(u16, Fresh)>,
    missing: Option<u16>,
}

impl Memory {
    /// Tables whose values tell the device: a register holds the unit id in its high byte and the address's low byte
    /// below; input registers the complement of that; a bit is set when unit and address have an odd sum.
    pub fn new(unit: u8) -> Self {
        let register = |address: usize| u16::from_be_bytes([unit, address as u8]);
        let bit = |address: usize| (usize::from(unit) + address) % 2 == 1;
        Self {
            coils: (0..TABLE_LENGTH).map(bit).collect(),
            discrete_inputs: (0..TABLE_LENGTH).map(bit).collect(),
            holding: (0..TABLE_LENGTH).map(register).collect(),
            input: (0..TABLE_LENGTH).map(|address| !register(address)).collect(),
            unit,
            fresh: None,
            missing: None,
        }
    }

    /// Makes four registers from `address` on, in both tables, change with every read.
    pub fn set_fresh(&mut self, address: u16) {
        self.fresh = Some((address, Fresh::default()));
    }

    /// Makes reads that touch `address`, in whichever table, exception 02.
    pub fn set_missing(&mut self, address: u16) {
        self.missing = Some(address);
    }

    /// Executes `pdu`, which has at least a function code: the response, or an exception code.
    pub fn execute(&mut self, pdu: &[u8]) -> Result<Vec<u8>, u8> {
        let (&function, data) = pdu.split_first().ok_or(ILLEGAL_FUNCTION)?;
        if let (1..=4, Ok([address, count]), Some(missing)) = (function, words(data), self.missing)
            && range(address, count).contains(&missing.into())
        {
            return Err(ILLEGAL_ADDRESS);
        }
        let mut response = match function {
            1 => read_bits(&self.coils, data)?,
            2 => read_bits(&self.discrete_inputs, data)?,
            3 | 4 => self.read_registers(function, data)?,
            5 => self.write_coil(data)?,
            6 => self.write_register(data)?,
            // Sub-function 0 returns the query.
            8 if data.starts_with(&[0, 0]) => data.to_vec(),
            15 => self.write_coils(data)?,
            16 => self.write_registers(data)?,
            17 => vec![2, self.unit, 0xff],
            22 => self.mask_write(data)?,
            23 => self.read_write(data)?,
            // User-defined: the payload and the code's complement, so that the length is known by silence only.
            65..=72 => [data, &[!function]].concat(),
            _ => return Err(ILLEGAL_FUNCTION),
        };
        response.insert(0, function);
        Ok(response)
    }

    fn read_registers(&mut self, function: u8, data: &[u8]) -> Result<Vec<u8>, u8> {
        let [address, count] = words(data)?;
        self.refresh(address, count);
        let table = if function == 3 { &self.holding } else { &self.input };
        if !(1..=125).contains(&count) {
            return Err(ILLEGAL_VALUE);
        }
        let registers = table.get(range(address, count)).ok_or(ILLEGAL_ADDRESS)?;
        Ok(std::iter::once(registers.len() as u8 * 2)
            .chain(registers.iter().flat_map(|register| register.to_be_bytes()))
            .collect())
    }

    /// Computes the fresh registers anew when a read of `count` from `address` touches them.
    fn refresh(&mut self, address: u16, count: u16) {
        let Some((first, fresh)) = &mut self.fresh else { return };
        let place = range(*first, Fresh::REGISTERS);
        let read = range(address, count);
        if read.start < place.end && place.start < read.end {
            *fresh = fresh.next();
            for table in [&mut self.holding, &mut self.input] {
                table[place.clone()].copy_from_slice(&fresh.registers());
            }
        }
    }

    fn write_coil(&mut self, data: &[u8]) -> Result<Vec<u8>, u8> {
        let [address, value] = words(data)?;
        let value = match value {
            0xff00 => true,
            0x0000 => false,
            _ => return Err(ILLEGAL_VALUE),
        };
        *self.coils.get_mut(usize::from(address)).ok_or(ILLEGAL_ADDRESS)? = value;
        Ok(data.to_vec())
    }

    fn write_register(&mut self, data: &[u8]) -> Result<Vec<u8>, u8> {
        let [address, value] = words(data)?;
        *self.holding.get_mut(usize::from(address)).ok_or(ILLEGAL_ADDRESS)? = value;
        Ok(data.to_vec())
    }

    fn write_coils(&mut self, data: &[u8]) -> Result<Vec<u8>, u8> {
        let (head, [bytes, values @ ..]) = data.split_at_checked(4).ok_or(ILLEGAL_VALUE)? else {
            return Err(ILLEGAL_VALUE);
        };
        let [address, count] = words(head)?;
        let fits = usize::from(*bytes) == values.len() && values.len() == usize::from(count).div_ceil(8);
        if !(1..=1968).contains(&count) || !fits {
            return Err(ILLEGAL_VALUE);
        }
        let coils = self.coils.get_mut(range(address, count)).ok_or(ILLEGAL_ADDRESS)?;
        for (index, coil) in coils.iter_mut().enumerate() {
            *coil = values[index / 8] >> (index % 8) & 1 == 1;
        }
        Ok(head.to_vec())
    }

    fn write_registers(&mut self, data: &[u8]) -> Result<Vec<u8>, u8> {
        let (head, values) = data.split_at_checked(4).ok_or(ILLEGAL_VALUE)?;
        let [address, count] = words(head)?;
        self.store(address, count, 123, values)?;
        Ok(head.to_vec())
    }

    fn mask_write(&mut self, data: &[u8]) -> Result<Vec<u8>, u8> {
        let [address, and, or] = words(data)?;
        let register = self.holding.get_mut(usize::from(address)).ok_or(ILLEGAL_ADDRESS)?;
        *register = *register & and | or & !and;
        Ok(data.to_vec())
    }

    fn read_write(&mut self, data: &[u8]) -> Result<Vec<u8>, u8> {
        let (head, values) = data.split_at_checked(8).ok_or(ILLEGAL_VALUE)?;
        let [_, count, write_address, write_count] = words(head)?;
        if !(1..=125).contains(&count) {
            return Err(ILLEGAL_VALUE);
        }
        // The write is done before the read, Application Protocol 6.17.
        self.store(write_address, write_count, 121, values)?;
        self.read_registers(3, &head[..4])
    }

    /// Writes registers from a byte count and as many bytes.
    fn store(&mut self, address: u16, count: u16, most: u16, values: &[u8]) -> Result<(), u8> {
        let (&bytes, values) = values.split_first().ok_or(ILLEGAL_VALUE)?;
        let fits = usize::from(bytes) == values.len() && values.len() == 2 * usize::from(count);
        if !(1..=most).contains(&count) || !fits {
            return Err(ILLEGAL_VALUE);
        }
        let registers = self.holding.get_mut(range(address, count)).ok_or(ILLEGAL_ADDRESS)?;
        for (register, value) in registers.iter_mut().zip(values.chunks_exact(2)) {
            *register = u16::from_be_bytes([value[0], value[1]]);
        }
        Ok(())
    }
}

fn range(address: u16, count: u16) -> std::ops::Range<usize> {
    usize::from(address)..usize::from(address) + usize::from(count)
}

/// The data as big-endian words, when there are exactly as many.
fn words<const N: usize>(data: &[u8]) -> Result<[u16; N], u8> {
    let words: Vec<u16> =
        data.chunks(2).filter_map(|pair| Some(u16::from_be_bytes(pair.try_into().ok()?))).collect();
    if data.len() == 2 * N { words.try_into().map_err(|_| ILLEGAL_VALUE) } else { Err(ILLEGAL_VALUE) }
}

fn read_bits(table: &[bool], data: &[u8]) -> Result<Vec<u8>, u8> {
    let [address, count] = words(data)?;
    if !(1..=2000).contains(&count) {
        return Err(ILLEGAL_VALUE);
    }
    let bits = table.get(range(address, count)).ok_or(ILLEGAL_ADDRESS)?;
    let bytes = bits
        .chunks(8)
        .map(|eight| eight.iter().enumerate().fold(0, |byte, (index, &bit)| byte | u8::from(bit) << index));
    Ok(std::iter::once(bits.len().div_ceil(8) as u8).chain(bytes).collect())
}

#[cfg(test)]
mod tests {
    use super::{Memory, TABLE_LENGTH};

    #[test]
    fn the_specifications_examples_come_out() {
        let mut memory = Memory::new(1);
        memory.holding[107..110].copy_from_slice(&[0x022b, 0, 0x64]);
        let response = [3, 6, 0x02, 0x2b, 0, 0, 0, 0x64];
        assert_eq!(memory.execute(&[3, 0, 107, 0, 3]), Ok(response.to_vec()), "6.3");
        memory.holding[4] = 0x12;
        memory.execute(&[22, 0, 4, 0, 0xf2, 0, 0x25]).unwrap();
        assert_eq!(memory.holding[4], 0x17, "6.16");
        memory.execute(&[15, 0, 19, 0, 10, 2, 0xcd, 0x01]).unwrap();
        assert_eq!(memory.execute(&[1, 0, 19, 0, 10]), Ok(vec![1, 2, 0xcd, 0x01]), "6.11");
    }

    #[test]
    fn the_largest_frames_are_taken_and_one_more_is_not() {
        let mut memory = Memory::new(1);
        assert_eq!(memory.execute(&[3, 0, 0, 0, 125]).unwrap().len(), 252);
        assert_eq!(memory.execute(&[3, 0, 0, 0, 126]), Err(3));
        let write =
            |count: u8| [vec![16, 0, 0, 0, count, 2 * count], vec![7; 2 * usize::from(count)]].concat();
        assert_eq!(memory.execute(&write(123)), Ok(vec![16, 0, 0, 0, 123]));
        assert_eq!(memory.execute(&write(124)), Err(3));
    }

    #[test]
    fn exceptions_say_what_is_wrong() {
        let mut memory = Memory::new(1);
        let end = (TABLE_LENGTH as u16).to_be_bytes();
        assert_eq!(memory.execute(&[99]), Err(1));
        assert_eq!(memory.execute(&[3, end[0], end[1], 0, 1]), Err(2));
        assert_eq!(memory.execute(&[5, 0, 0, 0x12, 0x34]), Err(3));
        assert_eq!(memory.execute(&[6, 0, 0, 0]), Err(3), "a byte is missing");
    }

    #[test]
    fn a_write_and_read_in_one_writes_first() {
        let mut memory = Memory::new(1);
        let request = [23, 0, 5, 0, 1, 0, 5, 0, 1, 2, 0xab, 0xcd];
        assert_eq!(memory.execute(&request), Ok(vec![23, 2, 0xab, 0xcd]));
    }
}
