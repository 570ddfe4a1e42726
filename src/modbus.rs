//! Modbus codecs.
