//! The three chips: what memories and peripherals they have, and where (RM0090, RM0410, RM0433: memory maps and vector tables).

/// A family of chips, whose peripherals are alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// STM32F42x, a Cortex-M4.
    F4,
    /// STM32F76x, a Cortex-M7.
    F7,
    /// STM32H74x, a Cortex-M7.
    H7,
}

/// An image of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Variant {
    /// With EtherCAT and data points.
    Ethercat,
    /// Without.
    Smaller,
    /// Without, and with users and the audit trail.
    Users,
}

/// A board: its name as `cargo xtask board` knows it, and its chip.
#[derive(Clone, Copy, Debug)]
pub struct Board {
    /// The folder in `boards/`.
    pub name: &'static str,
    /// Its chip's family.
    pub family: Family,
    /// Which of its images it runs.
    pub(crate) image: Variant,
    /// First address and length of each memory that the program has, in their order.
    pub(crate) memories: &'static [(u32, u32)],
    /// First address and length of the program's part of the flash. Up to its end instructions are executed; what follows is a device.
    pub(crate) active: (u32, u32),
    /// Where an update waits, and where the state of the swap is.
    pub(crate) update: u32,
    pub(crate) state: u32,
    /// First address of the two sectors that hold the settings, and the length of one.
    pub(crate) settings: (u32, u32),
    /// A revision of the chip that is sold now.
    pub(crate) revision: u16,
    /// Address of the chip's unique number.
    pub(crate) unique: u32,
}

/// Where the flash begins.
pub(crate) const FLASH: u32 = 0x0800_0000;
/// Its length.
pub(crate) const FLASH_BYTES: u32 = 0x20_0000;

/// The NUCLEO-F429ZI.
pub const NUCLEO_F429ZI: Board = Board {
    name: "nucleo_f429zi",
    family: Family::F4,
    image: Variant::Ethercat,
    memories: &[(0x1000_0000, 0x1_0000), (0x2000_0000, 0x3_0000)],
    active: (0x0802_0000, 0x8_0000),
    update: 0x0812_0000,
    state: 0x0810_0000,
    settings: (0x081c_0000, 0x2_0000),
    revision: 0x2001,
    unique: 0x1fff_7a10,
};

/// The NUCLEO-F767ZI.
pub const NUCLEO_F767ZI: Board = Board {
    name: "nucleo_f767zi",
    family: Family::F7,
    image: Variant::Ethercat,
    memories: &[(0x2000_0000, 0x8_0000)],
    active: (0x0804_0000, 0x8_0000),
    update: 0x080c_0000,
    state: 0x0800_8000,
    settings: (0x0818_0000, 0x4_0000),
    revision: 0x1001,
    unique: 0x1ff0_f420,
};

/// The NUCLEO-H743ZI.
pub const NUCLEO_H743ZI: Board = Board {
    name: "nucleo_h743zi",
    family: Family::H7,
    image: Variant::Ethercat,
    memories: &[(0x2400_0000, 0x8_0000)],
    active: (0x0802_0000, 0x8_0000),
    update: 0x0810_0000,
    state: 0x081a_0000,
    settings: (0x081c_0000, 0x2_0000),
    revision: 0x2003,
    unique: 0x1ff1_e800,
};

impl Board {
    /// The same board with the smaller image.
    #[must_use]
    pub const fn without_ethercat(self) -> Self {
        Self { image: Variant::Smaller, ..self }
    }

    /// The same board with the image that has users and the audit trail.
    #[must_use]
    pub const fn with_users(self) -> Self {
        Self { image: Variant::Users, ..self }
    }

    /// Length of that part of the flash from which instructions are executed.
    pub(crate) fn code_bytes(&self) -> u32 {
        self.active.0 + self.active.1 - FLASH
    }
}

/// A peripheral that has a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Device {
    Rcc,
    Pwr,
    Flash,
    Syscfg,
    Exti,
    Gpio,
    Watchdog,
    Timer,
    /// Of the board's UARTs: see [`UARTS`].
    Uart(usize),
    /// DMA1 or DMA2.
    Dma(usize),
    Dmamux,
    Spi,
    Ethernet,
    Random,
    Debug,
    AxiTarget,
    Core,
    System,
}

/// Instances and interrupts of the board's UARTs: four lines, and the console.
pub(crate) const UARTS: [(&str, u32, usize); 5] = [
    ("USART2", 0x4000_4400, 38),
    ("USART6", 0x4001_1400, 71),
    ("UART4", 0x4000_4c00, 52),
    ("UART5", 0x4000_5000, 53),
    ("USART3", 0x4000_4800, 39),
];

/// Interrupts of the streams of DMA1 and DMA2.
pub(crate) const DMA_INTERRUPTS: [[usize; 8]; 2] =
    [[11, 12, 13, 14, 15, 16, 17, 47], [56, 57, 58, 59, 60, 68, 69, 70]];
pub(crate) const FLASH_INTERRUPT: usize = 4;
pub(crate) const SPI_INTERRUPT: usize = 35;
pub(crate) const EXTI_INTERRUPT: usize = 40;
pub(crate) const TIMER_INTERRUPT: usize = 50;
pub(crate) const ETHERNET_INTERRUPT: usize = 61;

const F: &[(u32, u32, Device)] = &[
    (0x4000_0c00, 0x400, Device::Timer),
    (0x4000_3000, 0x400, Device::Watchdog),
    (0x4000_7000, 0x400, Device::Pwr),
    (0x4001_3000, 0x400, Device::Spi),
    (0x4001_3800, 0x400, Device::Syscfg),
    (0x4001_3c00, 0x400, Device::Exti),
    (0x4002_0000, 0x2c00, Device::Gpio),
    (0x4002_3800, 0x400, Device::Rcc),
    (0x4002_3c00, 0x400, Device::Flash),
    (0x4002_6000, 0x400, Device::Dma(0)),
    (0x4002_6400, 0x400, Device::Dma(1)),
    (0x4002_8000, 0x1400, Device::Ethernet),
    (0x5006_0800, 0x400, Device::Random),
    (0xe004_2000, 0x400, Device::Debug),
    (0x1ff0_0000, 0x10_0000, Device::System),
];

const H: &[(u32, u32, Device)] = &[
    (0x4000_0c00, 0x400, Device::Timer),
    (0x4001_3000, 0x400, Device::Spi),
    (0x4002_0000, 0x400, Device::Dma(0)),
    (0x4002_0400, 0x400, Device::Dma(1)),
    (0x4002_0800, 0x400, Device::Dmamux),
    (0x4002_8000, 0x1400, Device::Ethernet),
    (0x4802_1800, 0x400, Device::Random),
    (0x5100_8000, 0x1000, Device::AxiTarget),
    (0x5200_2000, 0x400, Device::Flash),
    (0x5800_0000, 0x400, Device::Exti),
    (0x5800_0400, 0x400, Device::Syscfg),
    (0x5800_4800, 0x400, Device::Watchdog),
    (0x5802_0000, 0x2c00, Device::Gpio),
    (0x5802_4400, 0x400, Device::Rcc),
    (0x5802_4800, 0x400, Device::Pwr),
    (0x5c00_1000, 0x400, Device::Debug),
    (0x1ff0_0000, 0x10_0000, Device::System),
];

/// What is at `address`, for people.
pub(crate) fn name(family: Family, address: u32) -> String {
    match device(family, address) {
        Some((Device::Uart(uart), offset)) => {
            format!("{address:#010x}, which is {} + {offset:#x},", UARTS[uart].0)
        }
        Some((device, offset)) => format!("{address:#010x}, which is {device:?} + {offset:#x},"),
        None => format!("{address:#010x}"),
    }
}

/// The peripheral at `address`, and the offset in it.
pub(crate) fn device(family: Family, address: u32) -> Option<(Device, u32)> {
    let within = |base: u32, size: u32| address.wrapping_sub(base) < size;
    if within(0xe000_0000, 0x1_0000) {
        return Some((Device::Core, address - 0xe000_0000));
    }
    if let Some(uart) = UARTS.iter().position(|&(_, base, _)| within(base, 0x400)) {
        return Some((Device::Uart(uart), address - UARTS[uart].1));
    }
    let map = if family == Family::H7 { H } else { F };
    map.iter().find(|&&(base, size, _)| within(base, size)).map(|&(base, _, device)| (device, address - base))
}
