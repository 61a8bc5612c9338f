"""Keys of diagnosis.json, written out once more: one more or less is another version of the schema."""

KEYS = (
    "schema_version verdict level omnibus causes named confusable explanations not_testable gain noise where links "
    "whiteness unexplained audit notes model seed versions separation"
).split()
SCHEMA_VERSION = 5
