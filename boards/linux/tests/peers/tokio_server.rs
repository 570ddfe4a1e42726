//! An RTU server by tokio-modbus, for the functions that rmodbus does not have.

use std::future::{Ready, ready};
use std::path::Path;
use std::sync::Mutex;
use std::sync::mpsc::sync_channel;
use std::thread;

use tokio_modbus::prelude::{ExceptionCode, Request, Response, SlaveRequest};
use tokio_modbus::server::{Service, rtu};

use crate::lines::first_input;

pub(crate) const SERVER_ID: u8 = 0x42;
pub(crate) const SERVER_NAME: &[u8] = b"tokio-modbus";
const REGISTERS: usize = 100;

/// Responds as `unit` at `device` until the line hangs up.
pub(crate) fn start(device: &Path, unit: u8) {
    let device = device.to_owned();
    let (ready, started) = sync_channel(1);
    thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build().unwrap();
        runtime.block_on(async {
            let server = rtu::Server::new_from_path(device, 115_200).unwrap();
            ready.send(()).unwrap();
            // Its error is the end of the line.
            let _ = server.serve_forever(Device { unit, holding: Mutex::new([0; REGISTERS]) }).await;
        });
    });
    started.recv().unwrap();
}

struct Device {
    unit: u8,
    holding: Mutex<[u16; REGISTERS]>,
}

type Outcome = Result<Option<Response>, ExceptionCode>;

impl Service for Device {
    type Request = SlaveRequest<'static>;
    type Response = Option<Response>;
    type Exception = ExceptionCode;
    type Future = Ready<Outcome>;

    fn call(&self, asked: SlaveRequest<'static>) -> Self::Future {
        ready(if asked.slave == self.unit { self.respond(asked.request).map(Some) } else { Ok(None) })
    }
}

impl Device {
    fn respond(&self, request: Request<'_>) -> Result<Response, ExceptionCode> {
        let mut holding = self.holding.lock().unwrap();
        Ok(match request {
            Request::ReadInputRegisters(first, count) => Response::ReadInputRegisters(
                (first..first + count).map(|address| first_input(self.unit) + address).collect(),
            ),
            Request::ReadHoldingRegisters(first, count) => {
                Response::ReadHoldingRegisters(part(&mut holding, first, count)?.to_vec())
            }
            Request::WriteMultipleRegisters(first, values) => {
                part(&mut holding, first, values.len() as u16)?.copy_from_slice(&values);
                Response::WriteMultipleRegisters(first, values.len() as u16)
            }
            Request::MaskWriteRegister(address, and, or) => {
                let [register] = part(&mut holding, address, 1)? else { unreachable!() };
                *register = (*register & and) | (or & !and);
                Response::MaskWriteRegister(address, and, or)
            }
            Request::ReadWriteMultipleRegisters(first, count, to, values) => {
                part(&mut holding, to, values.len() as u16)?.copy_from_slice(&values);
                Response::ReadWriteMultipleRegisters(part(&mut holding, first, count)?.to_vec())
            }
            Request::ReportServerId => Response::ReportServerId(SERVER_ID, true, SERVER_NAME.to_vec()),
            _ => return Err(ExceptionCode::IllegalFunction),
        })
    }
}

fn part(holding: &mut [u16; REGISTERS], first: u16, count: u16) -> Result<&mut [u16], ExceptionCode> {
    let first = usize::from(first);
    holding.get_mut(first..first + usize::from(count)).ok_or(ExceptionCode::IllegalDataAddress)
}
