//! The instruction sets the kernels are compiled for, and proof that the machine has them.
//!
//! A value of [`Avx2`] or [`Avx512`] can only come from [`InstructionSet::available`], which asks the
//! processor; holding one is what makes the intrinsics inside sound. Everything is `inline(always)`, so
//! that it lands in the `target_feature` function of [`Scalar::dispatch`](crate::kernel::Scalar::dispatch).
//! Results may differ in the last bit between sets (fused or not), never between thread counts.

/// Vector arithmetic on `T`, as one instruction set does it.
pub(crate) trait Lanes<T: Copy>: Copy {
    /// A register of `T`.
    type Vector: Copy;
    /// Numbers in a register.
    const WIDTH: usize;
    /// All lanes `value`.
    fn splat(self, value: T) -> Self::Vector;
    /// The first `WIDTH` numbers of `from`; panics if there are fewer.
    fn load(self, from: &[T]) -> Self::Vector;
    /// Writes the first `WIDTH` numbers of `to`; panics if there are fewer.
    fn store(self, vector: Self::Vector, to: &mut [T]);
    /// `a * b + c`.
    fn multiply_add(self, a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector;
    /// Asks for the cache line of `from[at]`, which need not exist.
    fn prefetch(self, from: &[T], at: usize);
    /// `a + b`.
    fn add(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
}

/// What any machine can do; the compiler makes of it what the target allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Portable;

macro_rules! portable {
    ($scalar:ty, $width:literal) => {
        impl Lanes<$scalar> for Portable {
            type Vector = [$scalar; $width];
            const WIDTH: usize = $width;
            #[inline(always)]
            fn splat(self, value: $scalar) -> Self::Vector {
                [value; $width]
            }
            #[inline(always)]
            fn load(self, from: &[$scalar]) -> Self::Vector {
                let mut vector = [0.0; $width];
                vector.copy_from_slice(&from[..$width]);
                vector
            }
            #[inline(always)]
            fn store(self, vector: Self::Vector, to: &mut [$scalar]) {
                to[..$width].copy_from_slice(&vector);
            }
            #[inline(always)]
            fn multiply_add(self, a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector {
                std::array::from_fn(|lane| a[lane] * b[lane] + c[lane])
            }
            #[inline(always)]
            fn prefetch(self, _from: &[$scalar], _at: usize) {}
            #[inline(always)]
            fn add(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
                std::array::from_fn(|lane| a[lane] + b[lane])
            }
        }
    };
}

portable!(f32, 8);
portable!(f64, 4);

/// AVX2 and FMA.
#[cfg(target_arch = "x86_64")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Avx2(());

/// AVX-512 F.
#[cfg(target_arch = "x86_64")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Avx512(());

#[cfg(target_arch = "x86_64")]
macro_rules! x86 {
    ($token:ty, $scalar:ty, $width:literal, $vector:ident, $splat:ident, $load:ident, $store:ident, $fma:ident, $add:ident) => {
        impl Lanes<$scalar> for $token {
            type Vector = std::arch::x86_64::$vector;
            const WIDTH: usize = $width;
            #[inline(always)]
            fn splat(self, value: $scalar) -> Self::Vector {
                // SAFETY: `self` exists, so the processor has this instruction set.
                unsafe { std::arch::x86_64::$splat(value) }
            }
            #[inline(always)]
            fn load(self, from: &[$scalar]) -> Self::Vector {
                let from = &from[..$width];
                // SAFETY: `self` exists, so the processor has this instruction set; `from` holds WIDTH
                // numbers, and the unaligned load asks for nothing else.
                unsafe { std::arch::x86_64::$load(from.as_ptr()) }
            }
            #[inline(always)]
            fn store(self, vector: Self::Vector, to: &mut [$scalar]) {
                let to = &mut to[..$width];
                // SAFETY: as for `load`; `to` is borrowed uniquely.
                unsafe { std::arch::x86_64::$store(to.as_mut_ptr(), vector) }
            }
            #[inline(always)]
            fn multiply_add(self, a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector {
                // SAFETY: `self` exists, so the processor has this instruction set.
                unsafe { std::arch::x86_64::$fma(a, b, c) }
            }
            #[inline(always)]
            fn prefetch(self, from: &[$scalar], at: usize) {
                use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
                // SAFETY: a prefetch is a hint: it reads nothing and cannot fault, whatever the address.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(from.as_ptr().wrapping_add(at).cast()) }
            }
            #[inline(always)]
            fn add(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
                // SAFETY: `self` exists, so the processor has this instruction set.
                unsafe { std::arch::x86_64::$add(a, b) }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
x86!(Avx2, f32, 8, __m256, _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_fmadd_ps, _mm256_add_ps);
#[cfg(target_arch = "x86_64")]
x86!(
    Avx2,
    f64,
    4,
    __m256d,
    _mm256_set1_pd,
    _mm256_loadu_pd,
    _mm256_storeu_pd,
    _mm256_fmadd_pd,
    _mm256_add_pd
);
#[cfg(target_arch = "x86_64")]
x86!(
    Avx512,
    f32,
    16,
    __m512,
    _mm512_set1_ps,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    _mm512_fmadd_ps,
    _mm512_add_ps
);
#[cfg(target_arch = "x86_64")]
x86!(
    Avx512,
    f64,
    8,
    __m512d,
    _mm512_set1_pd,
    _mm512_loadu_pd,
    _mm512_storeu_pd,
    _mm512_fmadd_pd,
    _mm512_add_pd
);

/// An instruction set this machine has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum InstructionSet {
    /// Whatever the target's baseline is.
    Portable(Portable),
    /// x86-64 of 2013.
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2),
    /// x86-64 of 2017.
    #[cfg(target_arch = "x86_64")]
    Avx512(Avx512),
}

impl InstructionSet {
    /// All sets this machine has, widest last.
    pub(crate) fn available() -> Vec<Self> {
        #[cfg_attr(not(target_arch = "x86_64"), expect(unused_mut, reason = "nothing to push elsewhere"))]
        let mut sets = vec![Self::Portable(Portable)];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                sets.push(Self::Avx2(Avx2(())));
            }
            if is_x86_feature_detected!("avx512f") {
                sets.push(Self::Avx512(Avx512(())));
            }
        }
        sets
    }

    /// The widest set this machine has.
    pub(crate) fn widest() -> Self {
        Self::available().pop().unwrap_or(Self::Portable(Portable))
    }
}
