//! The one way from Python into the core: interpreter released, threads bounded, errors mapped.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::OnceLock;

use geoerr_core::least_squares::clear_wide_registers;
use pyo3::marker::Ungil;
use pyo3::prelude::*;
use rayon::ThreadPool;

use crate::errors::CoreError;

/// More threads than processors have cores only wait for each other; a million of them, by a slip of the keyboard, would
/// fill the machine.
const MOST_THREADS: usize = 256;

/// Threads that wait for the next call: to start them costs more than many a call has to do.
struct Kept {
    process: u32,
    threads: usize,
    pool: Rc<ThreadPool>,
}

thread_local! {
    static KEPT: RefCell<Option<Kept>> = const { RefCell::new(None) };
}

/// The process that has Rayon's own threads, which work where no number is asked for: the first that asked for none.
static OWNER_OF_ALL_CORES: OnceLock<u32> = OnceLock::new();

/// Runs `work` with the interpreter released, on at most `threads` threads, and [`MOST_THREADS`] (0 = all cores).
///
/// Results never depend on `threads`: the core splits work into fixed blocks and joins them in order.
pub fn enter_core<T, E, F>(py: Python<'_>, threads: usize, work: F) -> PyResult<T>
where
    F: FnOnce() -> Result<T, E> + Send + Ungil,
    T: Send + Ungil,
    E: Into<CoreError> + Send + Ungil,
{
    // NumPy may have multiplied matrices on this thread.
    clear_wide_registers();
    let outcome = py.detach(|| -> Result<Result<T, E>, CoreError> {
        if threads == 0 && is_owner_of_all_cores() {
            return Ok(work());
        }
        Ok(pool_of(threads.min(MOST_THREADS))?.install(work))
    });
    outcome.map_err(PyErr::from)?.map_err(|error| PyErr::from(error.into()))
}

/// Whether Rayon's own threads are this process's: in a fork of one that had them nobody would ever do the work.
fn is_owner_of_all_cores() -> bool {
    let process = std::process::id();
    *OWNER_OF_ALL_CORES.get_or_init(|| process) == process
}

/// The pool of the caller's last call, or a new one where that had another number of threads.
fn pool_of(threads: usize) -> Result<Rc<ThreadPool>, CoreError> {
    let process = std::process::id();
    KEPT.with_borrow_mut(|kept| {
        if let Some(last) = kept.as_ref()
            && last.process == process
            && last.threads == threads
        {
            return Ok(Rc::clone(&last.pool));
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|source| CoreError::thread_pool(&source))?;
        let pool = Rc::new(pool);
        let new = Kept { process, threads, pool: Rc::clone(&pool) };
        if let Some(last) = kept.replace(new)
            && last.process != process
        {
            // A fork copies the memory of a pool, not its threads: there is nobody to tell that it has ended.
            std::mem::forget(last);
        }
        Ok(pool)
    })
}
