"""The paper's simulation and tables, reproduced, with least squares beside them."""
