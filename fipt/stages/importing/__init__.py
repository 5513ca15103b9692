"""Other people's layouts into the dataset form."""
