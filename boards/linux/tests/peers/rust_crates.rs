//! tokio-modbus asks; rmodbus and tokio-modbus respond.

use std::net::{Ipv4Addr, SocketAddr};

use tokio_modbus::client::sync::tcp::connect_slave_with_timeout;
use tokio_modbus::client::sync::{Client, Context, Reader, Writer};
use tokio_modbus::prelude::{ExceptionCode, Request, Response, Slave};

use crate::common::{PATIENCE, Program};
use crate::lines::{Line, first_input, program};
use crate::tokio_server::{SERVER_ID, SERVER_NAME};

const UNIT: u8 = 9;

const ROUTE: &str = "route P502 1-247 * * P1
";

fn client(program: &Program) -> Context {
    let at = SocketAddr::from((Ipv4Addr::LOCALHOST, program.port));
    connect_slave_with_timeout(at, Slave(UNIT), Some(PATIENCE)).unwrap()
}

#[test]
fn tokio_modbus_reads_and_writes_a_unit_played_by_rmodbus() {
    let lines = [Line::with_rmodbus(UNIT)];
    let program = program(&lines, ROUTE);
    let mut client = client(&program);

    let every_third: Vec<bool> = (0..21).map(|bit| bit % 3 == 0).collect();
    assert_eq!(client.read_discrete_inputs(0, 21).unwrap(), Ok(every_third));
    client.write_single_coil(3, true).unwrap().unwrap();
    client.write_multiple_coils(5, &[true, false, true]).unwrap().unwrap();
    let coils = [false, false, false, true, false, true, false, true, false];
    assert_eq!(client.read_coils(0, 9).unwrap(), Ok(coils.to_vec()));

    let inputs: Vec<u16> = (10..135).map(|address| first_input(UNIT) + address).collect();
    assert_eq!(client.read_input_registers(10, 125).unwrap(), Ok(inputs));
    client.write_single_register(7, 0xabcd).unwrap().unwrap();
    client.write_multiple_registers(8, &[1, 2, 3]).unwrap().unwrap();
    assert_eq!(client.read_holding_registers(7, 4).unwrap(), Ok(vec![0xabcd, 1, 2, 3]));
}

#[test]
fn tokio_modbus_gets_the_exceptions_of_a_unit_played_by_rmodbus() {
    let lines = [Line::with_rmodbus(UNIT)];
    let program = program(&lines, ROUTE);
    let mut client = client(&program);
    assert_eq!(client.read_coils(999, 2).unwrap(), Err(ExceptionCode::IllegalDataAddress));
    assert_eq!(client.write_single_register(1000, 1).unwrap(), Err(ExceptionCode::IllegalDataAddress));
    assert_eq!(client.masked_write_register(0, 0, 1).unwrap(), Err(ExceptionCode::IllegalFunction));
}

#[test]
fn tokio_modbus_asks_itself_for_what_rmodbus_does_not_have() {
    let lines = [Line::with_tokio_modbus(UNIT)];
    let program = program(&lines, ROUTE);
    let mut client = client(&program);
    client.write_multiple_registers(0, &[0x0012, 7]).unwrap().unwrap();
    client.masked_write_register(0, 0x00f2, 0x0025).unwrap().unwrap();
    let read = client.read_write_multiple_registers(0, 3, 1, &[8, 9]).unwrap();
    assert_eq!(read, Ok(vec![0x0017, 8, 9]));
    let id = client.call(Request::ReportServerId).unwrap();
    assert_eq!(id, Ok(Response::ReportServerId(SERVER_ID, true, SERVER_NAME.to_vec())));
    assert_eq!(client.read_coils(0, 1).unwrap(), Err(ExceptionCode::IllegalFunction));
    assert_eq!(client.read_holding_registers(99, 2).unwrap(), Err(ExceptionCode::IllegalDataAddress));
}
