//! The header of legacy files, and numbers and fields in text and binary.

use crate::io::{
    Field, IoError,
    input::{ByteOrder, InputFile, Scalar, TEXT_NUMBER, Tokens},
};

/// Reads a legacy file after its header.
pub(super) struct LegacyReader<'a> {
    pub file: &'a InputFile<'a>,
    pub tokens: Tokens<'a>,
    pub binary: bool,
}

impl<'a> LegacyReader<'a> {
    /// Reads the version, the title and the encoding.
    pub fn new(file: &'a InputFile<'a>) -> Result<Self, IoError> {
        let mut tokens = file.tokens();
        let first = tokens.line();
        if !first.starts_with(b"# vtk DataFile Version") {
            return Err(tokens.unexpected(first, "`# vtk DataFile Version`"));
        }
        tokens.line();
        if tokens.rest().is_empty() {
            return Err(file.truncated("the header"));
        }
        let binary = match tokens.line().trim_ascii() {
            b"ASCII" => false,
            b"BINARY" => true,
            other => return Err(tokens.unexpected(other, "ASCII or BINARY")),
        };
        Ok(Self { file, tokens, binary })
    }

    /// An error at the line of the last token.
    pub fn malformed(&self, found: impl Into<String>) -> IoError {
        self.tokens.malformed(found)
    }

    /// Skips lines to the next blank one.
    pub fn skip_metadata(&mut self) {
        self.tokens.line();
        while !self.tokens.rest().is_empty() && !self.tokens.line().is_empty() {}
    }

    /// An attribute with a fixed number of components.
    pub fn attribute(&mut self, components: usize, count: usize) -> Result<Field, IoError> {
        let name = self.tokens.word("a field")?;
        let scalar = self.scalar()?;
        self.field(name, scalar, components, count)
    }

    /// `SCALARS`, which name a lookup table before their values.
    pub fn scalars(&mut self, count: usize) -> Result<Field, IoError> {
        let name = self.tokens.word("a field")?;
        let scalar = self.scalar()?;
        let mut components = 1;
        if self.tokens.peek().is_some_and(|word| word != b"LOOKUP_TABLE") {
            components = self.tokens.count("components", 0)?;
        }
        for _ in 0..2 {
            self.tokens.word("LOOKUP_TABLE")?;
        }
        self.field(name, scalar, components, count)
    }

    /// `FIELD`: arrays with their own counts.
    pub fn field_arrays(&mut self) -> Result<Vec<Field>, IoError> {
        let mut fields = Vec::new();
        self.tokens.word("a field")?;
        for _ in 0..self.tokens.count("field arrays", 4 * TEXT_NUMBER)? {
            let mut name = self.tokens.word("a field")?;
            while name == "METADATA" {
                self.skip_metadata();
                name = self.tokens.word("a field")?;
            }
            let components = self.tokens.count("components", 0)?;
            let tuples = self.tokens.count("tuples", 0)?;
            let scalar = self.scalar()?;
            fields.push(self.field(name, scalar, components, tuples)?);
        }
        Ok(fields)
    }

    fn field(&mut self, name: String, scalar: Scalar, components: usize, count: usize) -> Result<Field, IoError> {
        let count = (components as u64).saturating_mul(count as u64);
        let values = self.floats(scalar, count, "values of a field")?;
        Ok(Field {
            name,
            components,
            values,
        })
    }

    /// A data type.
    pub fn scalar(&mut self) -> Result<Scalar, IoError> {
        let name = self.tokens.word("a data type")?;
        match name.to_ascii_lowercase().as_str() {
            "char" | "signed_char" | "vtktypeint8" => Ok(Scalar::I8),
            "unsigned_char" | "vtktypeuint8" => Ok(Scalar::U8),
            "short" | "vtktypeint16" => Ok(Scalar::I16),
            "unsigned_short" | "vtktypeuint16" => Ok(Scalar::U16),
            "int" | "vtktypeint32" => Ok(Scalar::I32),
            "unsigned_int" | "vtktypeuint32" => Ok(Scalar::U32),
            "long" | "vtktypeint64" => Ok(Scalar::I64),
            // VTK writes ids to legacy files as 32-bit integers, whatever their size in memory.
            "vtkidtype" => Ok(Scalar::I32),
            "unsigned_long" | "vtktypeuint64" => Ok(Scalar::U64),
            "float" => Ok(Scalar::F32),
            "double" => Ok(Scalar::F64),
            _ => Err(self.tokens.unexpected(name.as_bytes(), "a data type")),
        }
    }

    pub fn floats(&mut self, scalar: Scalar, count: u64, element: &str) -> Result<Vec<f64>, IoError> {
        self.values(scalar, count, element, Scalar::float, Tokens::float)
    }

    pub fn integers(&mut self, scalar: Scalar, count: u64, element: &str) -> Result<Vec<i64>, IoError> {
        self.values(scalar, count, element, Scalar::integer, Tokens::integer)
    }

    fn values<T>(
        &mut self,
        scalar: Scalar,
        count: u64,
        element: &str,
        from_bytes: impl Fn(Scalar, &[u8], ByteOrder) -> T,
        from_text: impl Fn(&mut Tokens<'a>, &str) -> Result<T, IoError>,
    ) -> Result<Vec<T>, IoError> {
        if self.binary {
            // The data begin after the line of the keyword, even when there are none.
            self.tokens.line();
            let available = self.tokens.rest().len();
            let count = self.file.checked_count(count, element, scalar.size(), available)?;
            let values = self.tokens.take(count * scalar.size(), element)?;
            let values = values.chunks_exact(scalar.size());
            Ok(values.map(|b| from_bytes(scalar, b, ByteOrder::Big)).collect())
        } else {
            let available = self.tokens.rest().len() + 1;
            let count = self.file.checked_count(count, element, TEXT_NUMBER, available)?;
            (0..count).map(|_| from_text(&mut self.tokens, element)).collect()
        }
    }
}
