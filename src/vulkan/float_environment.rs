//! The floating-point environment of a thread.
//!
//! Programs that take the library in may round to another side, flush small numbers to zero, or have exceptions raise a
//! signal. All of that would change pictures and identities, or end the process.

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
use std::arch::asm;

/// What the thread computes in: round to nearest, keep subnormal numbers, raise no signals. Dropping it restores what
/// was before, with the flags of the exceptions that happened before. Other processors than x86-64 and aarch64 are left
/// alone.
pub struct FloatEnvironment {
    #[cfg(target_arch = "x86_64")]
    sse: u32,
    /// As `fnstenv` writes it.
    #[cfg(target_arch = "x86_64")]
    x87: [u32; 7],
    /// Control and status.
    #[cfg(target_arch = "aarch64")]
    registers: [u64; 2],
    /// It belongs to its thread.
    thread: std::marker::PhantomData<*const ()>,
}

/// Round to nearest, all exceptions masked, no flags.
#[cfg(target_arch = "x86_64")]
const MXCSR: u32 = 0x1f80;

impl FloatEnvironment {
    /// Sets it, on this thread.
    #[cfg(target_arch = "x86_64")]
    pub fn enter() -> FloatEnvironment {
        let (mut sse, mut x87) = (0_u32, [0_u32; 7]);
        // SAFETY: the instructions write the two places, of the sizes that they write, and set control registers. At a
        // call no x87 register holds a value.
        unsafe {
            asm!("stmxcsr [{0}]", "fnstenv [{1}]", "fninit", "ldmxcsr [{2}]", in(reg) &raw mut sse,
                in(reg) &raw mut x87, in(reg) &MXCSR, options(nostack));
        }
        FloatEnvironment { sse, x87, thread: std::marker::PhantomData }
    }

    /// Sets it, on this thread.
    #[cfg(target_arch = "aarch64")]
    pub fn enter() -> FloatEnvironment {
        let mut registers = [0_u64; 2];
        // SAFETY: the instructions read and write the control and status registers alone.
        unsafe {
            asm!("mrs {0}, fpcr", "mrs {1}, fpsr", "msr fpcr, xzr", out(reg) registers[0],
                out(reg) registers[1], options(nostack));
        }
        FloatEnvironment { registers, thread: std::marker::PhantomData }
    }

    /// Nothing is known of this processor's.
    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
    pub fn enter() -> FloatEnvironment {
        FloatEnvironment { thread: std::marker::PhantomData }
    }
}

impl Drop for FloatEnvironment {
    fn drop(&mut self) {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the instructions read what `enter` has written.
        unsafe {
            asm!("fldenv [{0}]", "ldmxcsr [{1}]", in(reg) &self.x87, in(reg) &self.sse, options(nostack));
        }
        #[cfg(target_arch = "aarch64")]
        // SAFETY: the instructions write back what `enter` has read.
        unsafe {
            asm!("msr fpsr, {1}", "msr fpcr, {0}", in(reg) self.registers[0],
                in(reg) self.registers[1], options(nostack));
        }
    }
}
