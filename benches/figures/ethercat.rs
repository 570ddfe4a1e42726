//! EtherCAT: what a cycle costs on the SPI, how long a start takes, how images fare,
//! and how soon an output is read back.

mod gateway;
mod spi;
mod sub_device;

pub(crate) fn figures() {
    gateway::figures();
    spi::figures();
    sub_device::figures();
}
