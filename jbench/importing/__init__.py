"""Learning curves that were made outside jbench, most of them as records of the results database.

request.py           what to import: formats, columns, seeds
importer.py          reads all files, then writes a record for each seed
reader.py            CSV files as data frames of texts, and the checks of a curve's points
sb3.py               monitor.csv and evaluations.npz of stable-baselines3
tensorboard.py       event files of TensorBoard
columns.py           CSV files with columns of any name, and those that W&B exports
runs.py              imported curves as tables of runs
curve_file.py        curves of any environment in one file, which are reported without an import
"""
