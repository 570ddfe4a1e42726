//! mobgate on a W5500-EVB-Pico, or on a Raspberry Pi Pico with a W5500 at the same pins.
#![no_std]
#![no_main]

use embassy_executor::Spawner;
use mobgate_rp::pico;

// The linker's memory maps: a change must relink the image.
const _: (&[u8], &[u8]) = (include_bytes!("../regions.x"), include_bytes!("../../../memory.x"));

mobgate_image::info!(INFO, "W5500-EVB-Pico");

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    pico::run(spawner, &INFO, embassy_rp::init(Default::default())).await
}
