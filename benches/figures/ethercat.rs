//! EtherCAT: what a cycle costs on the SPI, how long a start takes, how images fare.

mod spi;
mod sub_device;

pub(crate) fn figures() {
    spi::figures();
    sub_device::figures();
}
