//! The memory map of the STM32F405 (RM0090, 2.3), and how its peripherals are clocked and reset (chapter 7).
//!
//! The library has the STM32F427's tables. The F405 has fewer peripherals, and some registers reset otherwise: each
//! difference is named here with its section. An access to a peripheral that the F405 lacks is an access to nothing.

use std::num::{NonZeroU32, NonZeroU64};

use rigless::device::RegisterFile;
use rigless::soc::stm32f427::peripherals::{
    ADC_COMMON, ADVANCED_TIMERS, CONTROLLERS, CONVERTERS, I2C_INTERFACES, SERIAL_PORTS, flash, rcc,
};
use rigless::soc::stm32f427::{self, SERIAL_INTERFACES};
use rigless::soc::{
    Bus, Clock, Cpu, Endian, EraseBlocks, Error, Gate, Layout, Peripheral, Region, RegisterSpec, WriteModify,
};

use crate::flash::{BASE, ERASED, SIZE};
use crate::{bxcan, otg};

/// The UART that the arm hangs on: USART2, on PA2 and PA3.
pub(crate) const ARM_PORT: &str = "USART2";

/// The clock and power controllers, whose state outlives a reset in part.
pub(super) const RCC: &str = "RCC";
pub(super) const PWR: &str = "PWR";

/// The flash interface.
pub(super) const FLASH: &str = "FLASH";

/// The timer that can measure the crystal (7.2.11).
pub(super) const CAPTURE: &str = "TIM11";

/// Core-coupled memory.
pub(super) const CCM: Region = Region::ram("ccm", 0x1000_0000, 64 << 10);

/// The memories (2.3, table 1; 3.4, table 5). The system region holds the unique id and the flash size (39.1, 39.2).
static MEMORY: [Region; 5] = [
    Region::flash("flash", BASE, SIZE as u64)
        .erased_in(&SECTORS)
        .erased_to(ERASED)
        .programmed_by(FLASH),
    CCM,
    Region::system("system", 0x1FFF_0000, 32 << 10),
    Region::ram("sram", 0x2000_0000, 128 << 10),
    Region::ram("backup_sram", 0x4002_4000, 4 << 10),
];

/// Where the boot loader in ROM is (2.4; AN2606), and the instruction with which the stub in its place starts.
pub(crate) const BOOT_LOADER: u64 = 0x1FFF_0000;
pub(crate) const BOOT_LOADER_START: u64 = BOOT_LOADER + 8;

/// The stub: a stack, a reset vector, and code that does nothing for ever.
pub(crate) const BOOT_LOADER_STUB: [u8; 12] = [
    0x00, 0x20, 0x00, 0x20, // stack: 0x2000_2000
    0x09, 0x00, 0xFF, 0x1F, // reset: BOOT_LOADER_START, Thumb
    0x00, 0xBF, // nop
    0xFE, 0xE7, // b .
];

/// Where the 96-bit unique id is (39.1) and the flash size in KiB, 16 bits (39.2).
pub(crate) const UNIQUE_ID: u64 = 0x1FFF_7A10;
pub(crate) const FLASH_SIZE: u64 = 0x1FFF_7A22;
pub(crate) const FLASH_KIB: u16 = 1024;

/// The flash's sectors (3.4, table 5).
static SECTORS: [EraseBlocks; 3] = [sectors(16 << 10, 4), sectors(64 << 10, 1), sectors(128 << 10, 7)];

const fn sectors(bytes: u64, count: u32) -> EraseBlocks {
    match (NonZeroU64::new(bytes), NonZeroU32::new(count)) {
        (Some(size), Some(count)) => EraseBlocks { size, count },
        _ => panic!("a sector has bytes"),
    }
}

/// A Cortex-M4 with FPU and the 82 interrupt lines of table 62.
static CPU: Cpu = Cpu::new("CM4", true, 82, Endian::Little);

/// What the F427 has and the F405 in its 64-pin package lacks (2.3, table 1; DS8626, table 2). OTG_FS is ours.
const ABSENT: [&str; 25] = [
    "UART7",
    "UART8",
    "SPI4",
    "SPI5",
    "SPI6",
    "SAI1",
    "GPIOJ",
    "GPIOK",
    "DMA2D",
    "DCMI",
    "CRYP",
    "HASH",
    "FMC",
    "Ethernet_MAC",
    "Ethernet_MMC",
    "Ethernet_PTP",
    "Ethernet_DMA",
    "OTG_FS_GLOBAL",
    "OTG_FS_HOST",
    "OTG_FS_DEVICE",
    "OTG_FS_PWRCLK",
    "OTG_HS_GLOBAL",
    "OTG_HS_HOST",
    "OTG_HS_DEVICE",
    "OTG_HS_PWRCLK",
];

/// Registers that reset otherwise than the F427's.
const RESETS: [(&str, &str, u64); 3] = [
    // 7.3.15, 7.3.18, 7.3.19: low-power clock enables of what there is.
    (RCC, "AHB1LPENR", 0x7E67_91FF),
    (RCC, "APB1LPENR", 0x36FE_C9FF),
    (RCC, "APB2LPENR", 0x0007_5F33),
];

/// The bit of RCC that lets an instance answer (7.3.10 to 7.3.14) and the one that resets it (7.3.5 to 7.3.9), for the
/// instances that have a model. The names of the registers and bits are those of the vendor's description.
const CLOCKED: [(&str, &str, &str, &str, &str); 39] = [
    ("I2C1", "APB1ENR", "I2C1EN", "APB1RSTR", "I2C1RST"),
    ("I2C2", "APB1ENR", "I2C2EN", "APB1RSTR", "I2C2RST"),
    ("I2C3", "APB1ENR", "I2C3EN", "APB1RSTR", "I2C3RST"),
    ("ADC1", "APB2ENR", "ADC1EN", "APB2RSTR", "ADCRST"),
    ("ADC2", "APB2ENR", "ADC2EN", "APB2RSTR", "ADCRST"),
    ("ADC3", "APB2ENR", "ADC3EN", "APB2RSTR", "ADCRST"),
    ("C_ADC", "APB2ENR", "ADC1EN", "APB2RSTR", "ADCRST"),
    ("USART1", "APB2ENR", "USART1EN", "APB2RSTR", "USART1RST"),
    ("USART2", "APB1ENR", "USART2EN", "APB1RSTR", "UART2RST"),
    ("USART3", "APB1ENR", "USART3EN", "APB1RSTR", "UART3RST"),
    ("USART6", "APB2ENR", "USART6EN", "APB2RSTR", "USART6RST"),
    ("UART4", "APB1ENR", "UART4EN", "APB1RSTR", "UART4RST"),
    ("UART5", "APB1ENR", "UART5EN", "APB1RSTR", "UART5RST"),
    ("CAN1", "APB1ENR", "CAN1EN", "APB1RSTR", "CAN1RST"),
    ("PWR", "APB1ENR", "PWREN", "APB1RSTR", "PWRRST"),
    ("TIM1", "APB2ENR", "TIM1EN", "APB2RSTR", "TIM1RST"),
    ("TIM2", "APB1ENR", "TIM2EN", "APB1RSTR", "TIM2RST"),
    ("TIM3", "APB1ENR", "TIM3EN", "APB1RSTR", "TIM3RST"),
    ("TIM4", "APB1ENR", "TIM4EN", "APB1RSTR", "TIM4RST"),
    ("TIM5", "APB1ENR", "TIM5EN", "APB1RSTR", "TIM5RST"),
    ("TIM8", "APB2ENR", "TIM8EN", "APB2RSTR", "TIM8RST"),
    (CAPTURE, "APB2ENR", "TIM11EN", "APB2RSTR", "TIM11RST"),
    ("SPI1", "APB2ENR", "SPI1EN", "APB2RSTR", "SPI1RST"),
    ("SPI2", "APB1ENR", "SPI2EN", "APB1RSTR", "SPI2RST"),
    ("SPI3", "APB1ENR", "SPI3EN", "APB1RSTR", "SPI3RST"),
    ("DMA1", "AHB1ENR", "DMA1EN", "AHB1RSTR", "DMA1RST"),
    ("DMA2", "AHB1ENR", "DMA2EN", "AHB1RSTR", "DMA2RST"),
    ("GPIOA", "AHB1ENR", "GPIOAEN", "AHB1RSTR", "GPIOARST"),
    ("GPIOB", "AHB1ENR", "GPIOBEN", "AHB1RSTR", "GPIOBRST"),
    ("GPIOC", "AHB1ENR", "GPIOCEN", "AHB1RSTR", "GPIOCRST"),
    ("GPIOD", "AHB1ENR", "GPIODEN", "AHB1RSTR", "GPIODRST"),
    ("GPIOE", "AHB1ENR", "GPIOEEN", "AHB1RSTR", "GPIOERST"),
    ("GPIOF", "AHB1ENR", "GPIOFEN", "AHB1RSTR", "GPIOFRST"),
    ("GPIOG", "AHB1ENR", "GPIOGEN", "AHB1RSTR", "GPIOGRST"),
    ("GPIOH", "AHB1ENR", "GPIOHEN", "AHB1RSTR", "GPIOHRST"),
    ("GPIOI", "AHB1ENR", "GPIOIEN", "AHB1RSTR", "GPIOIRST"),
    ("SDIO", "APB2ENR", "SDIOEN", "APB2RSTR", "SDIORST"),
    ("SYSCFG", "APB2ENR", "SYSCFGEN", "APB2RSTR", "SYSCFGRST"),
    ("OTG_FS", "AHB2ENR", "OTGFSEN", "AHB2RSTR", "OTGFSRST"),
];

/// Every timer: a written zero clears a flag of its SR (17.4.5, 18.4.5, 19.5.5, 20.4.4).
const TIMERS: [&str; 14] = [
    "TIM1", "TIM2", "TIM3", "TIM4", "TIM5", "TIM6", "TIM7", "TIM8", "TIM9", "TIM10", "TIM11", "TIM12", "TIM13", "TIM14",
];

/// The part's bus: every instance of the F405 with its registers, its gates and its clocks.
pub(super) fn bus() -> Result<Bus, Error> {
    let stock = stm32f427::builder().build()?;
    let absent = |name: &str| ABSENT.contains(&name);
    let instances: Vec<Peripheral> = stock
        .peripherals()
        .copied()
        .filter(|instance| !absent(instance.name))
        .chain([otg::PERIPHERAL])
        .collect();

    let mut builder = Bus::builder(CPU, &MEMORY, instances);
    for slot in stock.slots().iter().filter(|slot| !absent(slot.peripheral().name)) {
        let instance = slot.peripheral();
        for (register, value) in corrected_resets(instance.registers, slot.registers()) {
            builder = builder.reset(instance.name, register, value);
        }
        if let Some(clock) = stock.clock_of(instance.name) {
            builder = builder.clocked_by(instance.name, clock);
        }
    }
    for (instance, register, value) in RESETS {
        builder = builder.reset(instance, register, value);
    }
    for (instance, enables, enable, resets, reset) in CLOCKED {
        builder = builder
            .gate(instance, Gate::by(RCC, enables, enable))
            .reset_by(instance, Gate::by(RCC, resets, reset));
    }
    builder = builder
        .clocked_by(otg::PERIPHERAL.name, Clock::output(RCC, rcc::PLL48))
        .clocked_by(bxcan::CAN, Clock::output(RCC, rcc::PCLK1))
        .clocked_by(CAPTURE, Clock::output(RCC, rcc::APB2_TIMERS));

    // Write rules that the vendor's description lacks, and write protection of the backup domain (5.4.1, DBP).
    for timer in TIMERS {
        builder = builder.write_modify(timer, "SR", WriteModify::ZeroToClear);
    }
    for interface in I2C_INTERFACES {
        builder = builder.write_modify(interface, "SR1", WriteModify::ZeroToClear);
    }
    builder = builder
        .field("FLASH", "ACR", "LATENCY", flash::LATENCY)
        .field("FLASH", "CR", "LOCK", flash::LOCK)
        .field("FLASH", "CR", "STRT", flash::STRT)
        .field("FLASH", "OPTCR", "OPTLOCK", flash::OPTLOCK)
        .field("FLASH", "OPTCR", "OPTSTRT", flash::OPTSTRT)
        .declare("FLASH", "SR", &flash::RDERR)
        .write_modify("FLASH", "SR", WriteModify::OneToClear)
        .gate_writes(RCC, &["BDCR"], Gate::by(PWR, "CR", "DBP"))
        .gate_writes("RTC", &[], Gate::by(PWR, "CR", "DBP"));

    // Who listens to the lines that instances drive for each other.
    let serial = SERIAL_INTERFACES
        .iter()
        .chain(SERIAL_PORTS.iter().map(|port| &port.instance));
    let timers = ADVANCED_TIMERS.iter().map(|timer| &timer.instance);
    let controllers = CONTROLLERS.iter().map(|controller| &controller.instance);
    let others = ["RTC", RCC, ADC_COMMON, CONVERTERS[0]];
    for listener in serial.chain(timers).chain(controllers).chain(&others) {
        if !absent(listener) {
            builder = builder.reads_requests(listener);
        }
    }
    builder.build()
}

/// The registers that the library resets to another value than the vendor's description has.
fn corrected_resets<'a>(
    table: &'static [RegisterSpec],
    registers: &'a RegisterFile,
) -> impl Iterator<Item = (&'static str, u64)> + 'a {
    table
        .iter()
        .enumerate()
        .map(|(row, register)| (register, registers.get(Row(row))))
        .filter(|(register, value)| *value != register.reset)
        .map(|(register, value)| (register.name, value))
}

/// Any table's register by its number, to read it.
#[derive(Clone, Copy, Debug)]
struct Row(usize);

impl Layout for Row {
    const REGISTERS: &'static [RegisterSpec] = &[];

    fn from_index(index: usize) -> Option<Self> {
        Some(Self(index))
    }

    fn index(self) -> usize {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_part_has_what_the_f405_has_and_nothing_else() {
        let bus = bus().unwrap();
        for there in [
            "USART2", "TIM2", "TIM5", "DMA1", "IWDG", "OTG_FS", "GPIOA", "CAN1", "DBG",
        ] {
            assert!(bus.peripheral(there).is_some(), "{there}");
        }
        for name in ABSENT {
            assert!(bus.peripheral(name).is_none(), "{name}");
        }
        assert_eq!(bus.cpu().interrupt_lines, 82);
    }

    #[test]
    fn the_memories_are_as_large_as_the_parts() {
        let bus = bus().unwrap();
        let size = |name: &str| {
            bus.memory()
                .iter()
                .find(|region| region.name == name)
                .map(|region| region.size)
        };
        assert_eq!(size("flash"), Some(1024 << 10));
        assert_eq!(size("sram"), Some(128 << 10));
        assert_eq!(size("ccm"), Some(64 << 10));
        let sectors: u64 = SECTORS
            .iter()
            .map(|run| run.size.get() * u64::from(run.count.get()))
            .sum();
        assert_eq!(size("flash"), Some(sectors));
    }
}
