"""Upgrades rows written with an older schema version.

Version 2 (of version 1): `train_mse` of `encoder_epochs` becomes `train_loss`, since not every kind
of encoder minimizes a squared error; encoders are compared with PCA and a random projection.

Version 3 (of version 2): `episodes` and `evaluations` have `processor_time`.

Version 4 (of version 3): `episodes` has `prediction_loss`.

Version 5 (of version 4): `encoder_predictions` has `linear_r2` and `amplitude`.
"""

import pyarrow as pa

_RENAMED = {"encoder_epochs": {"train_mse": "train_loss"}}


def upgraded(table: str, rows: pa.Table, columns: pa.Schema) -> pa.Table:
    """Returns rows with the current columns; missing values are null."""
    new_names = _RENAMED.get(table, {})
    rows = rows.rename_columns([new_names.get(name, name) for name in rows.column_names])
    for field in columns:
        if field.name not in rows.column_names:
            rows = rows.append_column(field, pa.nulls(rows.num_rows, field.type))
    return rows
